//! Every limit of the server by its name; the unit is the last part.

use crate::episode::in_flight::SEAT_ACTS_WAITING_MAX;
use crate::episode::quota::Caps;
use crate::episode::registry::RECOVERIES_MAX;
use crate::fair::PARTIES_REMEMBERED_MAX;
use crate::hosted::HOSTED_ROUNDS_MAX;
use crate::store::{READERS_MAX, READERS_WAITING_MAX, READERS_WAITING_PER_GROUP_MAX};
use crate::work::{JOBS_WAITING_MAX, JOBS_WAITING_PER_GROUP_MAX};

/// Requests that wait for a permit of a stream, of each kind.
pub(super) const STREAMS_WAITING_MAX: usize = 16_384;

/// Of these, those of one group.
pub(super) const STREAMS_WAITING_PER_GROUP_MAX: usize = 4096;

/// The limits of the server. An error that comes from a limit names it.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Bytes of a body, and of one act among several.
    pub body_bytes_max: usize,
    /// Bytes of a body with acts of several seats.
    pub swarm_body_bytes_max: usize,
    /// Bytes of all bodies that are arriving.
    pub bodies_bytes_max: usize,
    /// Bytes of large bodies a second of an entrant, a key or an address, on average; 0 for no limit. Programs
    /// on this machine are not limited.
    pub large_body_bytes_per_key_s_max: usize,
    /// Bytes of large bodies a second of all entrants of a competition, on average; 0 for no limit.
    pub large_body_bytes_per_competition_s_max: usize,
    /// Large bodies that are handled at once.
    pub large_bodies_max: usize,
    /// Large bodies that wait for their turn.
    pub large_bodies_waiting_max: usize,
    /// Acts in one body.
    pub acts_max: usize,
    /// Observations in one answer.
    pub observations_max: usize,
    /// Observations in one answer where nobody says how many.
    pub observations_default: usize,
    /// Bytes of an answer that is made in memory: lists and observations continue in the next one.
    pub answer_bytes_max: usize,
    /// Episodes in one page.
    pub page_items_max: u32,
    /// Episodes in one page where nobody says how many.
    pub page_items_default: u32,
    /// Seconds that a request may wait.
    pub wait_s_max: u32,
    /// Requests that wait at once.
    pub waits_max: usize,
    /// Episodes that have not ended.
    pub episodes_unfinished_max: usize,
    /// Episodes of one key that have not ended.
    pub episodes_per_key_max: usize,
    /// Percent of all episodes that are reserved for organizers and for the next games of runs.
    pub episodes_reserved_percent: u32,
    /// How many episodes a competition, a key or an address may have open, in percent of those that are free.
    pub episodes_of_free_percent_max: u32,
    /// Games of one run.
    pub run_games_max: usize,
    /// Games of one run that are open at a time.
    pub run_parallel_max: u32,
    /// Games of one run that are open at a time where nobody says how many.
    pub run_parallel_default: u32,
    /// Bytes that the acts of one episode may take in the journal; small acts are taken beyond it.
    pub journal_bytes_per_episode_max: u64,
    /// Bytes that the acts of all episodes of a key may take in the journal.
    pub journal_bytes_per_key_max: u64,
    /// Bytes that the acts of all episodes of a competition may take in the journal.
    pub journal_bytes_per_competition_max: u64,
    /// Bytes of large acts a second of an entrant, a key or an address, on average; 0 for no limit.
    pub journal_bytes_per_key_s_max: u64,
    /// Bytes of large acts a second of all entrants of a competition, on average; 0 for no limit.
    pub journal_bytes_per_competition_s_max: u64,
    /// How much of the disk must be free for anything new, in percent.
    pub disk_free_percent_min: u32,
    /// Requests a second from one address, on average; 0 for no limit. Twice as many may come
    /// at once. Programs on this machine are not limited.
    pub address_requests_per_s_max: u32,
    /// Requests a second with one key and the tokens of its episodes; 0 for no limit.
    pub key_requests_per_s_max: u32,
    /// Jobs that are queued for the writer before acts are refused.
    pub backlog_jobs_max: usize,
    /// Bytes of the jobs that are queued for the writer before acts are refused.
    pub backlog_bytes_max: usize,
    /// Connections at once.
    pub connections_max: usize,
    /// Connections at once from one address, or one /64 network of IPv6; this host may have all.
    pub connections_per_address_max: usize,
    /// Requests of one address, or one /64 network of IPv6, that are not answered yet, also behind a proxy; this host may
    /// have any number.
    pub requests_per_address_max: usize,
    /// Percent of all connections that are reserved for addresses that have none.
    pub connections_reserved_percent: u32,
    /// Milliseconds in which a client has to send the head of a request, from its first byte on.
    pub head_ms_max: u64,
    /// Milliseconds in which a client has to send the body of a request, and some more for each of
    /// its bytes.
    pub body_ms_max: u64,
    /// Bytes of a body for which a client gets one more second.
    pub body_bytes_per_s_min: u64,
    /// Milliseconds in which a client has to take some more of an answer.
    pub write_ms_max: u64,
    /// Bytes a second of an answer that a client has to take, on average of the time in which some wait for it.
    pub write_bytes_per_s_min: u64,
    /// Milliseconds after which an idle connection is closed.
    pub idle_ms_max: u64,
    /// Milliseconds that open requests get to end when the server is asked to stop.
    pub drain_ms_max: u64,
    /// Characters of a model's name.
    pub model_chars_max: usize,
    /// Characters of a suite's name.
    pub suite_name_chars_max: usize,
    /// Characters of the reason for which something is voided.
    pub reason_chars_max: usize,
    /// Bytes of `agent_meta`.
    pub agent_meta_bytes_max: usize,
    /// Characters of an idempotency key.
    pub idempotency_key_chars_max: usize,
    /// Bytes of all worlds and all large answers together.
    pub memory_bytes_max: usize,
    /// Bytes of a part of a journal or an export that is read at once; one record more may come on top.
    pub stream_part_bytes_max: usize,
    /// Parts of journals that are read at once.
    pub journals_max: usize,
    /// Pieces of exports that are made at once.
    pub exports_max: usize,
    /// Exports that are made, or of which a piece waits for its reader.
    pub exports_open_max: usize,
    /// Of these, those of one party.
    pub exports_open_per_party_max: usize,
    /// Large answers that are made at once: observations with prompts or of many cells, and lists.
    pub large_answers_max: usize,
    /// Requests for large answers that wait for their turn.
    pub large_answers_waiting_max: usize,
    /// States of earlier rounds that are made at once.
    pub replays_max: usize,
    /// Requests for states of earlier rounds that wait for their turn.
    pub replays_waiting_max: usize,
    /// Event streams that are open.
    pub event_streams_max: usize,
    /// Of these, those of one party.
    pub event_streams_per_party_max: usize,
    /// Events that wait for a slow reader before it is dropped.
    pub events_pending_max: usize,
    /// Bytes of them.
    pub events_pending_bytes_max: usize,
    /// Entrants of a competition.
    pub entrants_max: usize,
    /// Entries in competitions an hour from one address, or one /64 network of IPv6, without an invitation; 0 for no
    /// limit. Programs on this machine are not limited.
    pub entries_per_address_h_max: u32,
    /// How much memory the games of a competition, a key or an address may take, in percent of what is free.
    pub memory_of_free_percent_max: u32,
}

impl Default for Limits {
    fn default() -> Self {
        Self {
            body_bytes_max: 256 * 1024,
            swarm_body_bytes_max: 8 * 1024 * 1024,
            bodies_bytes_max: 256 * 1024 * 1024,
            large_body_bytes_per_key_s_max: 16 * 1024 * 1024,
            large_body_bytes_per_competition_s_max: 64 * 1024 * 1024,
            large_bodies_max: 4,
            large_bodies_waiting_max: 1024,
            acts_max: 1024,
            observations_max: 1024,
            observations_default: 256,
            answer_bytes_max: 8_000_000,
            page_items_max: 1000,
            page_items_default: 50,
            wait_s_max: 60,
            waits_max: 20_000,
            episodes_unfinished_max: 20_000,
            episodes_per_key_max: 5_000,
            episodes_reserved_percent: 5,
            episodes_of_free_percent_max: 100,
            run_games_max: 1000,
            run_parallel_max: 64,
            run_parallel_default: 4,
            journal_bytes_per_episode_max: 64 * 1024 * 1024,
            journal_bytes_per_key_max: 16 * 1024 * 1024 * 1024,
            journal_bytes_per_competition_max: 64 * 1024 * 1024 * 1024,
            journal_bytes_per_key_s_max: 1024 * 1024,
            journal_bytes_per_competition_s_max: 4 * 1024 * 1024,
            disk_free_percent_min: 5,
            address_requests_per_s_max: 2_000,
            key_requests_per_s_max: 10_000,
            backlog_jobs_max: 50_000,
            backlog_bytes_max: 256 * 1024 * 1024,
            connections_max: 16_000,
            connections_per_address_max: 2000,
            requests_per_address_max: 2000,
            connections_reserved_percent: 5,
            head_ms_max: 10_000,
            body_ms_max: 5000,
            body_bytes_per_s_min: 32 * 1024,
            write_ms_max: 10_000,
            write_bytes_per_s_min: 4096,
            idle_ms_max: 75_000,
            drain_ms_max: 8000,
            model_chars_max: 200,
            suite_name_chars_max: 100,
            reason_chars_max: 500,
            agent_meta_bytes_max: 16 * 1024,
            idempotency_key_chars_max: 200,
            memory_bytes_max: 2 * 1024 * 1024 * 1024,
            stream_part_bytes_max: 256 * 1024,
            journals_max: 2,
            exports_max: 2,
            exports_open_max: 16,
            exports_open_per_party_max: 4,
            large_answers_max: 4,
            large_answers_waiting_max: 4096,
            replays_max: 16,
            replays_waiting_max: 1024,
            event_streams_max: 4096,
            event_streams_per_party_max: 512,
            events_pending_max: 64,
            events_pending_bytes_max: 1024 * 1024,
            entrants_max: 10_000,
            entries_per_address_h_max: 100,
            memory_of_free_percent_max: 100,
        }
    }
}

impl Limits {
    /// The caps of the per-owner quotas.
    #[must_use]
    pub const fn caps(&self) -> Caps {
        Caps {
            episodes_unfinished_max: self.episodes_unfinished_max,
            episodes_per_key_max: self.episodes_per_key_max,
            episodes_reserved_percent: self.episodes_reserved_percent,
            episodes_of_free_percent_max: self.episodes_of_free_percent_max,
            journal_bytes_per_episode_max: self.journal_bytes_per_episode_max,
            journal_bytes_per_key_max: self.journal_bytes_per_key_max,
            journal_bytes_per_competition_max: self.journal_bytes_per_competition_max,
            journal_bytes_per_key_s_max: self.journal_bytes_per_key_s_max,
            journal_bytes_per_competition_s_max: self.journal_bytes_per_competition_s_max,
        }
    }

    /// All limits by their names: those that can be set, and those that cannot.
    #[must_use]
    pub fn table(&self) -> Vec<(&'static str, u64)> {
        vec![
            ("body_bytes_max", self.body_bytes_max as u64),
            ("swarm_body_bytes_max", self.swarm_body_bytes_max as u64),
            ("bodies_bytes_max", self.bodies_bytes_max as u64),
            ("large_body_bytes_per_key_s_max", self.large_body_bytes_per_key_s_max as u64),
            (
                "large_body_bytes_per_competition_s_max",
                self.large_body_bytes_per_competition_s_max as u64,
            ),
            ("large_bodies_max", self.large_bodies_max as u64),
            ("large_bodies_waiting_max", self.large_bodies_waiting_max as u64),
            ("acts_max", self.acts_max as u64),
            ("observations_max", self.observations_max as u64),
            ("observations_default", self.observations_default as u64),
            ("answer_bytes_max", self.answer_bytes_max as u64),
            ("page_items_max", self.page_items_max.into()),
            ("page_items_default", self.page_items_default.into()),
            ("wait_s_max", self.wait_s_max.into()),
            ("waits_max", self.waits_max as u64),
            ("episodes_unfinished_max", self.episodes_unfinished_max as u64),
            ("episodes_per_key_max", self.episodes_per_key_max as u64),
            ("episodes_reserved_percent", self.episodes_reserved_percent.into()),
            ("episodes_of_free_percent_max", self.episodes_of_free_percent_max.into()),
            ("run_games_max", self.run_games_max as u64),
            ("run_parallel_max", self.run_parallel_max.into()),
            ("run_parallel_default", self.run_parallel_default.into()),
            ("journal_bytes_per_episode_max", self.journal_bytes_per_episode_max),
            ("journal_bytes_per_key_max", self.journal_bytes_per_key_max),
            ("journal_bytes_per_competition_max", self.journal_bytes_per_competition_max),
            ("journal_bytes_per_key_s_max", self.journal_bytes_per_key_s_max),
            ("journal_bytes_per_competition_s_max", self.journal_bytes_per_competition_s_max),
            ("disk_free_percent_min", self.disk_free_percent_min.into()),
            ("address_requests_per_s_max", self.address_requests_per_s_max.into()),
            ("key_requests_per_s_max", self.key_requests_per_s_max.into()),
            ("backlog_jobs_max", self.backlog_jobs_max as u64),
            ("backlog_bytes_max", self.backlog_bytes_max as u64),
            ("connections_max", self.connections_max as u64),
            ("connections_per_address_max", self.connections_per_address_max as u64),
            ("requests_per_address_max", self.requests_per_address_max as u64),
            ("connections_reserved_percent", self.connections_reserved_percent.into()),
            ("head_ms_max", self.head_ms_max),
            ("body_ms_max", self.body_ms_max),
            ("body_bytes_per_s_min", self.body_bytes_per_s_min),
            ("write_ms_max", self.write_ms_max),
            ("write_bytes_per_s_min", self.write_bytes_per_s_min),
            ("idle_ms_max", self.idle_ms_max),
            ("drain_ms_max", self.drain_ms_max),
            ("model_chars_max", self.model_chars_max as u64),
            ("suite_name_chars_max", self.suite_name_chars_max as u64),
            ("reason_chars_max", self.reason_chars_max as u64),
            ("agent_meta_bytes_max", self.agent_meta_bytes_max as u64),
            ("idempotency_key_chars_max", self.idempotency_key_chars_max as u64),
            ("memory_bytes_max", self.memory_bytes_max as u64),
            ("stream_part_bytes_max", self.stream_part_bytes_max as u64),
            ("journals_max", self.journals_max as u64),
            ("exports_max", self.exports_max as u64),
            ("exports_open_max", self.exports_open_max as u64),
            ("exports_open_per_party_max", self.exports_open_per_party_max as u64),
            ("large_answers_max", self.large_answers_max as u64),
            ("large_answers_waiting_max", self.large_answers_waiting_max as u64),
            ("replays_max", self.replays_max as u64),
            ("replays_waiting_max", self.replays_waiting_max as u64),
            ("seat_acts_waiting_max", SEAT_ACTS_WAITING_MAX.into()),
            ("heavy_jobs_max", JOBS_WAITING_MAX as u64),
            ("heavy_jobs_per_group_max", JOBS_WAITING_PER_GROUP_MAX as u64),
            ("hosted_rounds_max", HOSTED_ROUNDS_MAX as u64),
            ("take_ups_max", RECOVERIES_MAX as u64),
            ("readers_max", READERS_MAX as u64),
            ("readers_waiting_max", READERS_WAITING_MAX as u64),
            ("readers_waiting_per_group_max", READERS_WAITING_PER_GROUP_MAX as u64),
            ("streams_waiting_max", STREAMS_WAITING_MAX as u64),
            ("streams_waiting_per_group_max", STREAMS_WAITING_PER_GROUP_MAX as u64),
            ("parties_remembered_max", PARTIES_REMEMBERED_MAX as u64),
            ("event_streams_max", self.event_streams_max as u64),
            ("event_streams_per_party_max", self.event_streams_per_party_max as u64),
            ("events_pending_max", self.events_pending_max as u64),
            ("events_pending_bytes_max", self.events_pending_bytes_max as u64),
            ("entrants_max", self.entrants_max as u64),
            ("entries_per_address_h_max", self.entries_per_address_h_max.into()),
            ("memory_of_free_percent_max", self.memory_of_free_percent_max.into()),
        ]
    }
}
