//! Every limit of the server by its name; the unit is the last part.

use super::checks::{AGENT_META_DEPTH_MAX, FIELD_PROBLEMS_MAX};
use super::client::NETWORKS_PER_SITE_MAX;
use super::extract::BODY_VALUES_MAX;
use super::serve::HEAD_BYTES_MAX;
use crate::dataset::bounds::IMPORT_STATE_BYTES_MAX;
use crate::dataset::replay::IMPORT_CELLS_MAX;
use crate::episode::in_flight::SEAT_ACTS_WAITING_MAX;
use crate::episode::quota::Caps;
use crate::episode::registry::FORK_PIECE_ROWS_MAX;
use crate::fair::{HEAVY_AT_ONCE_MAX, PARTIES_REMEMBERED_MAX, REPLAYS_MAX, WAITING_MAX};
use crate::host::DISK_FREE_BYTES_ENOUGH;
use swarmbench_mcp::{MCP_STRUCTURED_BYTES_MAX, MCP_VALUES_MAX, MCP_WAIT_S_MAX};
use swarmbench_replay::{AGENT_ROUNDS_MAX, PAGE_BYTES_MAX, ROUNDS_MAX};

/// Declares the limits that can be set, with their defaults, and those that cannot, in the order of their table.
macro_rules! limits {
    (
        $(#[$about:meta])*
        first { $($(#[$doc:meta])* $first:ident: $first_type:ty = $first_default:expr,)* }
        fixed { $($fixed:ident = $value:expr,)* }
        last { $($(#[$last_doc:meta])* $last:ident: $last_type:ty = $last_default:expr,)* }
    ) => {
        $(#[$about])*
        #[derive(Clone, Copy, Debug)]
        pub struct Limits {
            $($(#[$doc])* pub $first: $first_type,)*
            $($(#[$last_doc])* pub $last: $last_type,)*
        }

        impl Default for Limits {
            fn default() -> Self {
                Self { $($first: $first_default,)* $($last: $last_default,)* }
            }
        }

        impl Limits {
            /// All limits by their names: those that can be set, and those that cannot.
            #[expect(clippy::cast_lossless, reason = "usize has no lossless conversion")]
            pub fn table(&self) -> Vec<(&'static str, u64)> {
                vec![
                    $((stringify!($first), self.$first as u64),)*
                    $((stringify!($fixed), $value as u64),)*
                    $((stringify!($last), self.$last as u64),)*
                ]
            }
        }
    };
}

limits! {
    /// The limits of the server. An error that comes from a limit names it.
    first {
        /// Bytes of a body, and of one act among several.
        body_bytes_max: usize = 256 * 1024,
        /// Bytes of a body with acts of several seats.
        swarm_body_bytes_max: usize = 8 * 1024 * 1024,
        /// Bytes of a body without a token.
        anonymous_body_bytes_max: usize = 64 * 1024,
        /// Bytes of a body for `/mcp` without the token of a seat.
        mcp_anonymous_body_bytes_max: usize = 16 * 1024,
        /// Bytes of all bodies that are arriving or being handled, parsed values included; requests with a token have as many
        /// again.
        bodies_bytes_max: usize = 256 * 1024 * 1024,
        /// Acts in one body.
        acts_max: usize = 1024,
        /// Observations in one answer.
        observations_max: usize = 1024,
        /// Bytes of an answer that is made in memory: lists and observations continue in the next answer.
        answer_bytes_max: usize = 8_000_000,
        /// Items of one page, and scores of one series.
        page_items_max: u32 = 1000,
        /// Seconds that a request may wait.
        wait_s_max: u32 = 60,
        /// Requests that wait at once.
        waits_max: usize = 20_000,
        /// Episodes that have not ended.
        episodes_unfinished_max: usize = 20_000,
        /// Episodes of one key that have not ended.
        episodes_per_key_max: usize = 5_000,
        /// Percent of all connections, episodes and entrants of a competition that are reserved for parties without any. Half as many
        /// episodes are reserved for organizers and for the next games of runs, and as many places again in a competition for
        /// holders of an invitation code and for organizers.
        reserved_percent: u32 = 10,
        /// Games of one run.
        run_games_max: usize = 1000,
        /// Games of one run that are open at a time.
        run_parallel_max: u32 = 64,
        /// Holders of a run's team.
        run_holders_max: usize = 64,
        /// Bytes of `agent_meta` of all holders of a run's team: each of its games stores them.
        holders_meta_bytes_max: usize = 64 * 1024,
        /// Rounds that a fork may take over.
        fork_rounds_max: u32 = 10_000,
        /// Forks that one request makes.
        fork_count_max: u32 = 64,
        /// Members of a team at a time, beside its founder.
        members_max: usize = 20,
        /// Members of a team that were ever added: removed ones stay in the list.
        members_ever_max: usize = 100,
        /// Renames of an entrant by itself.
        renames_max: u32 = 10,
        /// Practice runs that a key may start in 24 hours.
        practice_runs_per_day_max: usize = 100,
        /// Seats of the forks that one request makes.
        fork_seats_max: u64 = 4096,
        /// Acts that the forks of one request take over together.
        fork_acts_max: u64 = 262_144,
        /// Bytes that the acts of one episode may take in the journal; small acts are taken beyond this limit.
        journal_bytes_per_episode_max: u64 = 64 * 1024 * 1024,
        /// Bytes that the acts of all episodes of a key may take in the journal; the acts of a competition may take four times as many.
        journal_bytes_per_key_max: u64 = 16 * 1024 * 1024 * 1024,
        /// Bytes of large acts per second of an entrant, a key or an address, on average; all entrants of a competition together
        /// may send four times as many. 0 for no limit.
        journal_bytes_per_key_s_max: u64 = 1024 * 1024,
        /// Free space of the disk that anything new requires, in percent.
        disk_free_percent_min: u32 = 5,
        /// Requests per second from one address, on average; 0 for no limit. Twice as many may come at once. Programs on this
        /// machine are not limited.
        address_requests_per_s_max: u32 = 2_000,
        /// Requests per second with one key and the tokens of its episodes; 0 for no limit.
        key_requests_per_s_max: u32 = 10_000,
        /// Bytes of the jobs that are queued for the writer before acts are refused.
        backlog_bytes_max: usize = 256 * 1024 * 1024,
        /// Connections at once.
        connections_max: usize = 16_000,
        /// Connections at once from one address, or one /64 network of IPv6, and its unanswered requests behind a proxy; this host may
        /// have all. A /48 network may have `networks_per_site_max` times as many connections, as with all counts by address.
        connections_per_address_max: usize = 2000,
        /// Milliseconds in which a client has to send the head of a request, from its first byte on.
        head_ms_max: u64 = 10_000,
        /// Milliseconds in which a client has to send the body of a request; `body_bytes_per_s_min` adds time for its bytes.
        body_ms_max: u64 = 5000,
        /// Bytes of a body for which a client gets one more second.
        body_bytes_per_s_min: u64 = 32 * 1024,
        /// Milliseconds in which a client has to take the next bytes of an answer.
        write_ms_max: u64 = 10_000,
        /// Bytes per second of an answer that a client has to take, on average over the time in which bytes wait for it.
        write_bytes_per_s_min: u64 = 4096,
        /// Milliseconds after which an idle connection is closed.
        idle_ms_max: u64 = 75_000,
        /// Milliseconds that open requests get to end when the server is asked to stop.
        drain_ms_max: u64 = 8000,
        /// Characters of the name of a model or a suite, of an idempotency key and of a request's id.
        name_chars_max: usize = 200,
        /// Characters of the reason for which something is voided.
        reason_chars_max: usize = 500,
        /// Bytes of `agent_meta`.
        agent_meta_bytes_max: usize = 16 * 1024,
        /// Bytes of all worlds and all large answers together.
        memory_bytes_max: usize = 2 * 1024 * 1024 * 1024,
        /// Bytes of a part of a journal or an export that is read at once; a part may exceed this by one record.
        stream_part_bytes_max: usize = 256 * 1024,
        /// Exports that are being made, or a piece of which waits for its reader.
        exports_open_max: usize = 16,
        /// Requests of one kind of heavy work that run at once.
        heavy_at_once_max: usize = HEAVY_AT_ONCE_MAX,
        /// Replays that run at once: states of earlier rounds, and recoveries of games.
        replays_max: usize = REPLAYS_MAX,
    }
    fixed {
        networks_per_site_max = NETWORKS_PER_SITE_MAX,
        disk_free_bytes_enough = DISK_FREE_BYTES_ENOUGH,
        fork_piece_rows_max = FORK_PIECE_ROWS_MAX,
        seat_acts_waiting_max = SEAT_ACTS_WAITING_MAX,
        mcp_wait_s_max = MCP_WAIT_S_MAX,
        mcp_structured_bytes_max = MCP_STRUCTURED_BYTES_MAX,
        mcp_values_max = MCP_VALUES_MAX,
        body_values_max = BODY_VALUES_MAX,
        agent_meta_depth_max = AGENT_META_DEPTH_MAX,
        field_problems_max = FIELD_PROBLEMS_MAX,
        waiting_max = WAITING_MAX,
        head_bytes_max = HEAD_BYTES_MAX,
        replay_rounds_max = ROUNDS_MAX,
        replay_agent_rounds_max = AGENT_ROUNDS_MAX,
        replay_page_bytes_max = PAGE_BYTES_MAX,
        replay_import_cells_max = IMPORT_CELLS_MAX,
        import_state_bytes_max = IMPORT_STATE_BYTES_MAX,
        parties_remembered_max = PARTIES_REMEMBERED_MAX,
    }
    last {
        /// Event streams that are open.
        event_streams_max: usize = 4096,
        /// Events that wait for a slow reader before it is dropped.
        events_pending_max: usize = 64,
        /// Bytes of the events that wait for a slow reader.
        events_pending_bytes_max: usize = 1024 * 1024,
        /// Entrants of a competition.
        entrants_max: usize = 10_000,
        /// Entries in competitions per hour from one address, or one /64 network of IPv6, without an invitation; 0 for no
        /// limit. Programs on this machine are not limited.
        entries_per_address_h_max: u32 = 100,
    }
}

impl Limits {
    /// The caps of the per-owner quotas.
    pub const fn caps(&self) -> Caps {
        Caps {
            episodes_unfinished_max: self.episodes_unfinished_max,
            episodes_per_key_max: self.episodes_per_key_max,
            reserved_percent: self.reserved_percent,
            journal_bytes_per_episode_max: self.journal_bytes_per_episode_max,
            journal_bytes_per_key_max: self.journal_bytes_per_key_max,
            journal_bytes_per_key_s_max: self.journal_bytes_per_key_s_max,
        }
    }
}
