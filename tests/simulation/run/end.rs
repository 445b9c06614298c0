//! The end of a run: every episode ends, and none stays in memory.

use std::time::Duration;

use swarmbench::episode::quota::Purpose;
use swarmbench::episode::seating::Wanted;
use swarmbench::fair::Party;
use swarmbench::ids::{EpisodeId, EpisodeKey, Place};
use swarmbench::keys::OwnerKey;
use swarmbench_engine::AgentId;

/// Maximum number of waits of a request for servers.
const WAITS_MAX: usize = 400;

use super::{ROUNDS_MAX, STEPS_MAX, Server, SimulationRun, Step, UNUSED};
use crate::simulation::checker::{Episode, Invariant};
use crate::simulation::clients::{Acts, Request, act};

impl SimulationRun {
    /// Performs everything that needs neither time nor clients. In a cluster a request may
    /// have to wait for one of them, and time passes.
    pub(super) fn settle(&mut self) {
        self.drain();
        if !self.is_shared() {
            return;
        }
        for _ in 0..WAITS_MAX {
            if self.pending.is_empty() {
                return;
            }
            self.pass(Duration::from_millis(50));
            self.drain();
        }
        let open: Vec<_> = self.pending.keys().copied().collect();
        self.checker.check(Invariant::Progress, false, || format!("{open:?} wait for ever"));
    }

    pub(super) fn drain(&mut self) {
        for _ in 0..STEPS_MAX {
            if let Some(&task) = self.executor.runnable().first() {
                self.poll(task);
            } else if let Some(&place) = self.untold().first() {
                self.tell(place);
            } else if let Some(&place) = self.writing().first() {
                self.commit(place, self.servers[place].journal.queued());
            } else {
                return;
            }
        }
        self.checker.check(Invariant::Progress, false, || "the server does not rest".to_owned());
    }

    /// Injects no more faults, and ends every episode by play or by silence.
    pub(super) fn finish(&mut self) {
        if self.is_shared() {
            self.calm_down();
        } else if !self.failed().is_empty() {
            self.crash();
        }
        self.settle();
        // An episode that failed twice at once is left alone for a while.
        self.pass(Duration::from_secs(1));
        if self.options.silence {
            self.fall_silent();
        } else {
            self.play_on();
        }
        for (id, ..) in self.unfinished() {
            let tables = self.database.tables();
            let place = tables.key_of(&id).map(Place::Game);
            let owner = place.and_then(|place| tables.owner(place));
            drop(tables);
            let what = || format!("{id} has not ended, it is played by {owner:?}");
            self.checker.check(Invariant::Progress, false, what);
        }
        self.send_again();
        self.leave_memory();
        self.checker.ended(&self.database.tables().durable);
    }

    fn unfinished(&self) -> Vec<(EpisodeId, bool, Vec<AgentId>)> {
        let open = self.checker.episodes.values().filter(|episode| episode.end.is_none());
        let seats = |e: &Episode| e.world.agents().filter(|agent| e.is_clients(*agent)).collect();
        open.map(|e| (e.id.clone(), e.waiting, seats(e))).collect()
    }

    /// Lets clients play all unfinished episodes to their ends.
    fn play_on(&mut self) {
        // Each turn plays about a round: an act that is too long for its episode is refused.
        for _ in 0..3 * ROUNDS_MAX {
            for (id, waiting, seats) in self.unfinished() {
                if waiting {
                    let open = self.checker.episode(&id).map_or(0, Episode::count_open);
                    if open > 0 {
                        self.ask(id.clone(), Request::Claim(Wanted::Any(open)));
                        self.settle();
                    }
                    self.ask(id.clone(), Request::Start);
                    self.settle();
                }
                let seed = self.dice.below(1 << 30) as u64;
                self.ask(id.clone(), Request::Turn(seats, seed));
                self.settle();
                self.ask_for_the_escaped(id);
                self.settle();
            }
        }
    }

    /// Sends acts of agents that have escaped.
    fn ask_for_the_escaped(&mut self, id: EpisodeId) {
        let Some(episode) = self.checker.episode(&id) else { return };
        let round = episode.world.round();
        let gone = (episode.world.agents())
            .filter(|&agent| !episode.world.is_alive(agent) && episode.is_clients(agent));
        let acts: Acts = gone
            .map(|agent| (agent, act(&mut self.dice, &episode.spec.config, agent, round)))
            .collect();
        if !acts.is_empty() {
            self.ask(id, Request::Send(acts));
        }
    }

    /// Drops the last clients before they are answered. Then there are no requests, and hours pass.
    fn fall_silent(&mut self) {
        if self.options.crashes > 0 {
            if self.is_shared() {
                self.crash_and_start();
            } else {
                self.crash();
            }
            let hours = [0, 1, 3][self.dice.below(3)];
            self.pass(UNUSED + Duration::from_hours(hours));
        }
        for (id, ..) in self.unfinished() {
            self.ask(id, Request::Look);
        }
        while !self.pending.is_empty() {
            if self.dice.below(3) == 0 {
                self.step(Step::Leave);
            } else if !self.executor.runnable().is_empty() {
                self.step(Step::Poll);
            } else if !self.untold().is_empty() {
                self.step(Step::Tell);
            } else if !self.writing().is_empty() {
                self.step(Step::Commit);
            } else if self.is_shared() {
                self.pass(Duration::from_millis(50));
            }
        }
        for _ in 0..40 {
            self.pass(Duration::from_mins(10));
            self.settle();
            self.sweep();
            self.settle();
        }
    }

    /// Checks that acknowledged acts are acknowledged for ever.
    fn send_again(&mut self) {
        let receipts = self.checker.receipts();
        for (id, acts) in std::mem::take(&mut self.acts) {
            let known = (acts.into_iter())
                .filter(|(agent, act)| receipts.contains(&(id.clone(), act.round, *agent)));
            let acts: Acts = known.collect();
            if !acts.is_empty() {
                // One at a time, as a seat gets some of many simultaneous acts refused.
                self.ask(id, Request::Send(acts));
                self.settle();
            }
        }
    }

    /// Checks that ended episodes leave the memory and the quotas.
    fn leave_memory(&mut self) {
        // If an actor was lost at the end of its episode, the episode is visited once more at its idle deadline.
        for _ in 0..3 {
            self.pass(UNUSED);
            self.sweep();
            self.settle();
        }
        let tasks = self.executor.len();
        let what = || format!("{tasks} tasks go on for nobody");
        self.checker.check(Invariant::Progress, tasks == 0, what);
        for Server { registry, quotas, .. } in &self.servers {
            let (held, unfinished) = (registry.in_memory(), registry.unfinished());
            let what = || format!("{held} episodes are in memory, {unfinished} are counted");
            self.checker.check(Invariant::Quotas, held + unfinished == 0, what);
            // All places are free, and a single key gets half of them.
            let caps = self.options.caps;
            let most = caps.episodes_per_key_max.min(caps.episodes_unfinished_max / 2);
            let bytes: u64 =
                self.database.tables().bytes_by_owner().iter().map(|(_, bytes)| bytes).sum();
            if bytes < caps.journal_bytes_per_key_max {
                let places = 2_000..2_000 + i64::try_from(most).expect("few");
                let party = Party::of_key(Some(OwnerKey(1)));
                let refused = places
                    .map(|key| quotas.admit(EpisodeKey(key), party, Purpose::Usual))
                    .find_map(Result::err);
                let what = || format!("no place is left: {refused:?}");
                self.checker.check(Invariant::Quotas, refused.is_none(), what);
            }
        }
    }
}
