//! Checks of durable entries, which are replayed by the rules one by one.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use swarmbench::episode::Ending;
use swarmbench::episode::spec::Spec;
use swarmbench::hosted;
use swarmbench::store::entries::{
    ActRow, ClaimRow, EndRow, Entry, OpeningRow, RoundRow, SeatingRow,
};
use swarmbench_clock::after;
use swarmbench_engine::{AgentId, World};
use swarmbench_journal::chain::Head;
use swarmbench_journal::record::{ActRecord, Record, Source, round_record};
use swarmbench_journal::replay::{acts_of, living};

use super::{Checker, Episode, Invariant, Kept, same};

impl Checker {
    /// Entries became durable, all at once.
    pub(crate) fn durable(&mut self, entries: &[Entry]) {
        self.next_moment();
        for entry in entries {
            match entry {
                Entry::Open(row) => self.open(row),
                Entry::Start { episode, at } => {
                    if let Some(episode) = self.episodes.get_mut(episode) {
                        let (was_waiting, id) = (episode.waiting, episode.id.clone());
                        episode.waiting = false;
                        episode.last_act_at = *at;
                        let seated = episode.seated || !episode.spec.is_seated();
                        episode.began_at = *at;
                        let is_open = !episode.is_closed(*at);
                        self.check(Invariant::Closing, is_open, || format!("{id}: a late start"));
                        self.check(Invariant::OneAct, was_waiting, || format!("{id}: two starts"));
                        self.check(Invariant::Seats, seated, || format!("{id}: started too early"));
                    }
                }
                Entry::Claim(row) => self.claim(row),
                Entry::Seat(row) => self.seat(row),
                Entry::Act(row) => self.act(row),
                Entry::Round(row) => self.round(row),
                Entry::End(row) => self.end(row),
                // Tokens, keys and runs, which belong to no episode.
                _ => {}
            }
        }
    }

    fn open(&mut self, row: &OpeningRow) {
        if self.keys.contains_key(&row.id) || self.episodes.contains_key(&row.episode) {
            return self.broken(Invariant::OneAct, format!("{}: two openings", row.id));
        }
        let Ok(Record::Opening(opening)) = row.record.read() else {
            return self.broken(Invariant::Replay, format!("{}: no opening", row.id));
        };
        let spec = match Spec::from_opening(&opening) {
            Ok(spec) => spec,
            Err(problem) => {
                return self.broken(Invariant::Replay, format!("{}: {problem}", row.id));
            }
        };
        let world = World::new(Arc::clone(&spec.config));
        let head = Head::START.link(row.record.as_str().as_bytes());
        self.check(Invariant::Replay, head == row.head, || format!("{}: another head", row.id));
        let episode = Episode {
            id: row.id.clone(),
            waiting: row.waiting,
            end: None,
            owner: row.owner,
            holders: (spec.agents())
                .map(|agent| (!spec.open_seats.contains(&agent)).then_some(0))
                .collect(),
            hosted: match &spec.player {
                Some(player) => (spec.agents().filter(|agent| !spec.open_seats.contains(agent)))
                    .map(|agent| (agent, player.clone()))
                    .collect(),
                None => Vec::new(),
            },
            players: None,
            opening_head: head,
            seated: false,
            heads: vec![head],
            digests: vec![world.digest().0],
            banks: vec![vec![spec.bank; usize::from(spec.config.num_agents())]],
            acts: vec![BTreeMap::new()],
            last_act_at: row.at,
            created_at: row.at,
            began_at: row.at,
            lines: row.record.line(head),
            opened: BTreeMap::new(),
            reopened: None,
            end_told: false,
            seen: (0, false),
            seen_first: 0,
            world,
            spec,
        };
        self.stats.count("episodes", 1);
        self.creating.remove(&row.id);
        self.keys.insert(row.id.clone(), row.episode);
        self.episodes.insert(row.episode, episode);
    }

    fn claim(&mut self, row: &ClaimRow) {
        let Some(episode) = self.episodes.get_mut(&row.episode) else { return };
        let name = format!("{}: claim {}", episode.id, row.holder.number);
        let mut wrong = Vec::new();
        if row.holder.number == 0 {
            let own: Vec<AgentId> = (episode.world.agents())
                .filter(|agent| episode.spec.is_mixed() && !episode.spec.open_seats.contains(agent))
                .collect();
            if own != row.agents || row.holder.player != episode.spec.player {
                wrong.push(format!("{name} is not the creator's"));
            }
        } else {
            if episode.seated || !episode.waiting || episode.end.is_some() {
                wrong.push(format!("{name} comes after the start"));
            }
            for agent in &row.agents {
                if episode.holders[agent.index()].replace(row.holder.number).is_some() {
                    wrong.push(format!("{name}: {agent} had a holder"));
                }
                if let Some(player) = &row.holder.player {
                    episode.hosted.push((*agent, player.clone()));
                }
            }
            match (&row.holder.player, episode.spec.fill_after) {
                (None, _) => self.stats.count("seats claimed", row.agents.len()),
                (Some(_), Some(time)) => {
                    self.stats.count("seats filled", row.agents.len());
                    if row.holder.at < after(episode.created_at, time) {
                        wrong.push(format!("{name} fills seats too early"));
                    }
                }
                (Some(_), None) => wrong.push(format!("{name} is of nobody")),
            }
        }
        for what in wrong {
            self.broken(Invariant::Seats, what);
        }
    }

    fn seat(&mut self, row: &SeatingRow) {
        let Some(episode) = self.episodes.get_mut(&row.episode) else { return };
        let name = format!("{}: who holds which seat", episode.id);
        let mut wrong = Vec::new();
        if std::mem::replace(&mut episode.seated, true) || episode.world.round() > 0 {
            wrong.push((Invariant::Seats, format!("{name} is told twice, or too late")));
        }
        let told = match row.record.read() {
            Ok(Record::Seats(told)) => told.seats.iter().map(|seat| Some(seat.holder)).collect(),
            _ => Vec::new(),
        };
        if told != episode.holders || told.contains(&None) {
            let holders = &episode.holders;
            wrong.push((Invariant::Seats, format!("{name}: {told:?}, it is {holders:?}")));
        }
        let head = episode.opening_head.link(row.record.as_str().as_bytes());
        if head != row.head {
            wrong.push((Invariant::Replay, format!("{name}: another head")));
        }
        episode.heads[0] = head;
        episode.lines.push_str(&row.record.line(head));
        self.all_broken(wrong);
    }

    fn act(&mut self, row: &ActRow) {
        let Some(episode) = self.episodes.get_mut(&row.episode) else { return };
        let mut wrong: Vec<(Invariant, String)> = Vec::new();
        let name = format!("{}: the act of {} in round {}", episode.id, row.agent, row.round);
        let open = episode.world.round();
        if episode.end.is_some() || row.round != open {
            wrong
                .push((Invariant::OneAct, format!("{name} came in round {open} or after the end")));
        }
        if episode.waiting || !episode.world.is_alive(row.agent) {
            wrong.push((Invariant::Barrier, format!("{name} came before the start or of nobody")));
        }
        let Ok(record) = row.record.read::<ActRecord>() else {
            return self.broken(Invariant::Replay, format!("{name} cannot be read"));
        };
        let by_player = record.source == Source::Player;
        let kept = Kept { record, raw: row.record.clone(), waiting_for: row.waiting_for };
        if kept.record.agent != row.agent.to_string() {
            wrong.push((Invariant::Replay, format!("{name} has another name")));
        }
        if let Some(acts) = episode.acts.get_mut(row.round as usize) {
            if acts.insert(row.agent, kept).is_some() {
                wrong.push((Invariant::OneAct, format!("{name} is the second")));
            }
            let left = living(&episode.world).count().saturating_sub(acts.len());
            if row.round == open && row.waiting_for as usize != left {
                let told = row.waiting_for;
                wrong.push((Invariant::Barrier, format!("{name}: {told} to come, it is {left}")));
            }
        }
        if by_player {
            let idle_at = episode.idle_at();
            if row.at > idle_at {
                let at = row.at;
                wrong.push((Invariant::Idle, format!("{name} came at {at}, idle at {idle_at}")));
            }
            episode.last_act_at = row.at.max(episode.last_act_at);
        } else {
            self.stats.count("clocks run out", 1);
        }
        self.all_broken(wrong);
    }

    fn round(&mut self, row: &RoundRow) {
        let Some(episode) = self.episodes.get_mut(&row.episode) else { return };
        let mut wrong: Vec<(Invariant, String)> = Vec::new();
        let name = format!("{}: round {}", episode.id, row.round);
        if episode.end.is_some() || row.round != episode.world.round() || episode.world.is_over() {
            let open = episode.world.round();
            return self.broken(Invariant::OneAct, format!("{name} is resolved in round {open}"));
        }
        if episode.is_closed(episode.began_at) {
            let began_at = episode.began_at;
            wrong.push((Invariant::Closing, format!("{name} is played, it began at {began_at}")));
        } else if episode.is_closed(row.at) {
            self.stats.count("rounds over the closing time", 1);
        }
        episode.began_at = row.at;
        let recorded = &episode.acts[row.round as usize];
        let missing: Vec<_> =
            living(&episode.world).filter(|agent| !recorded.contains_key(agent)).collect();
        if !missing.is_empty() {
            wrong.push((Invariant::Barrier, format!("{name} is resolved without {missing:?}")));
        }
        // The acts of the server's players must follow from their observations, whatever happened to the server.
        let players = episode.players.get_or_insert_with(|| {
            episode.hosted.sort_unstable();
            hosted::Players::new(&episode.spec, &episode.hosted).expect("players that are built in")
        });
        for (agent, decided) in players.decide(&episode.world) {
            let kept = recorded.get(&agent).filter(|kept| kept.by_player());
            self.stats.count("acts of the server", usize::from(kept.is_some()));
            if kept.is_some_and(|kept| !same(&kept.record, &decided.decision.record(agent, 0))) {
                wrong.push((Invariant::Seats, format!("{name}: {agent} forgot something")));
            }
        }
        let mut banks = episode.banks[row.round as usize].clone();
        for (agent, kept) in recorded {
            let spent = Duration::from_millis(kept.record.bank_spent_ms);
            match banks[agent.index()].checked_sub(spent) {
                Some(left) => banks[agent.index()] = left,
                None => wrong.push((Invariant::Clocks, format!("{name}: {agent} overspent"))),
            }
        }
        match acts_of(&episode.spec.config, recorded.values().map(|kept| &kept.record)) {
            Ok(acts) => episode.world.step(&acts),
            Err(problem) => return self.broken(Invariant::Replay, format!("{name}: {problem}")),
        }
        let (digest, score) = (episode.world.digest(), episode.world.score());
        let raw = recorded.values().map(|kept| &kept.raw);
        let record = round_record(row.round, raw, &digest.to_string(), score);
        let head = episode.heads[row.round as usize].link(record.as_str().as_bytes());
        if digest.0 != row.digest || score.to_bits() != row.score.to_bits() || head != row.head {
            wrong.push((Invariant::Replay, format!("{name} does not play again as it was played")));
        }
        episode.lines.push_str(&record.line(head));
        episode.heads.push(head);
        episode.digests.push(digest.0);
        episode.banks.push(banks);
        episode.acts.push(BTreeMap::new());
        self.stats.count("rounds", 1);
        self.all_broken(wrong);
    }

    fn end(&mut self, row: &EndRow) {
        let Some(episode) = self.episodes.get_mut(&row.episode) else { return };
        let mut wrong: Vec<(Invariant, String)> = Vec::new();
        let name = format!("{}: its end", episode.id);
        if episode.end.is_some() {
            return self.broken(Invariant::OneAct, format!("{name} is the second"));
        }
        let Ok(Record::End(end)) = row.record.read() else {
            return self.broken(Invariant::Replay, format!("{name} cannot be read"));
        };
        let Some(ending) = Ending::parse(&end.reason) else {
            return self.broken(Invariant::Replay, format!("{name} has no reason"));
        };
        let head = episode.heads[episode.heads.len() - 1].link(row.record.as_str().as_bytes());
        if head != row.head || ending.status().name() != row.status {
            wrong.push((Invariant::Replay, format!("{name} has another head or status")));
        }
        let open = &episode.acts[episode.acts.len() - 1];
        if !open.values().map(|kept| &kept.record).eq(&end.open_acts) {
            wrong.push((Invariant::Replay, format!("{name} has other open acts")));
        }
        let bytes: usize = episode
            .acts
            .iter()
            .flat_map(BTreeMap::values)
            .map(|kept| kept.raw.as_str().len())
            .sum();
        if bytes as u64 != row.bytes {
            wrong
                .push((Invariant::Quotas, format!("{name} counts {} bytes of {bytes}", row.bytes)));
        }
        let (idle_at, now) = (episode.idle_at(), self.now);
        if ending == Ending::Idle && (row.at < idle_at || now < idle_at) {
            let at = row.at;
            wrong.push((Invariant::Idle, format!("{name} is at {at}, {now}, idle at {idle_at}")));
        }
        // This end needs that no round may begin, and that the last round was not cut off.
        let cut = end.open_acts.len();
        let fits = episode.is_closed(row.at)
            && cut == 0
            && (episode.waiting || episode.is_closed(episode.began_at));
        if ending == Ending::Closed && !fits {
            let at = row.at;
            wrong.push((Invariant::Closing, format!("{name} closes at {at}, {cut} open acts")));
        }
        self.stats.count(
            match ending {
                Ending::TaskDone if row.rounds == 0 => "ended: solved by the layout",
                Ending::TaskDone => "ended: task done",
                Ending::RoundsPlayed => "ended: rounds played",
                Ending::Aborted => "ended: aborted",
                Ending::Idle => "ended: idle",
                Ending::Closed => "ended: closed",
            },
            1,
        );
        episode.lines.push_str(&row.record.line(head));
        episode.end = Some((ending, head));
        self.all_broken(wrong);
    }
}
