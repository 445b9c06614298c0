//! Checks of answers: acknowledgements are durable, and refusals are true.

use swarmbench::episode::Snapshot;
use swarmbench::episode::actor::{ActError, ClaimError, Claimed, StartError};
use swarmbench::episode::lockstep::{Receipt, RecordedAct, Refusal, Submission};
use swarmbench::episode::quota::{ACT_BYTES_ALWAYS, Full};
use swarmbench::episode::recovery::RecoveryError;
use swarmbench::episode::registry::CreateError;
use swarmbench::episode::seating::SeatTaken;
use swarmbench::ids::EpisodeId;
use swarmbench::store::StoreError;
use swarmbench_engine::AgentId;
use swarmbench_journal::record::Source;

use super::{Acked, Checker, Invariant, SeatRound, Sent, same};
use crate::simulation::clients::{RequestId, SimAnswer};
use swarmbench::cluster::Incarnation;

impl Checker {
    #[expect(clippy::too_many_lines, reason = "one arm for each kind of answer")]
    pub(crate) fn answered(&mut self, server: Incarnation, number: RequestId, answer: SimAnswer) {
        let moment = self.next_moment();
        let Some(mut sent) = self.requests.remove(&number) else { return };
        if self.is_shared {
            // If the request was sent again, its acts may be in the mailbox of another server.
            let (here, elsewhere) =
                sent.arrived.into_iter().partition(|arrived| arrived.server == server);
            let (id, moment) = (sent.id.clone(), sent.moment);
            self.orphan(Sent {
                id,
                moment,
                floor: sent.floor,
                arrived: elsewhere,
                held: sent.held,
            });
            sent.arrived = here;
        }
        let id = sent.id.clone();
        let failed = self.failed.get(&server).copied();
        // A request sent after the failure must not be acknowledged.
        let too_late = failed.is_some_and(|failed| failed < sent.moment);
        let failed = failed.is_some();
        let acks = match answer {
            SimAnswer::Looked => false,
            SimAnswer::Away => {
                // The creation may still become durable.
                return self.failure(&id, failed, &StoreError::Away);
            }
            SimAnswer::Nothing => {
                return self.broken(Invariant::Durable, format!("{id} is not found"));
            }
            SimAnswer::NotTakenUp(RecoveryError::Broken { problem, .. }) => {
                return self.broken(Invariant::Replay, format!("{id} is not taken up: {problem}"));
            }
            SimAnswer::NotTakenUp(RecoveryError::Journal(error))
            | SimAnswer::State(_, Err(RecoveryError::Journal(error)))
            | SimAnswer::Started(Err(StartError::Journal(error)))
            | SimAnswer::Claimed(_, Err(ClaimError::Journal(error)))
            | SimAnswer::Aborted(Err(error)) => {
                return self.failure(&id, failed, &error);
            }
            SimAnswer::Created(Err(CreateError::Work(error)))
            | SimAnswer::NotTakenUp(RecoveryError::Work(error))
            | SimAnswer::State(_, Err(RecoveryError::Work(error))) => {
                unreachable!("work is done at once: {error}")
            }
            SimAnswer::Started(Err(StartError::SeatsOpen(_))) => {
                self.stats.count("refused: seats_open", 1);
                let mixed = self.episode(&id).is_some_and(|episode| episode.spec.is_mixed());
                self.check(Invariant::TrueRefusals, mixed, || format!("{id} has no open seats"));
                false
            }
            SimAnswer::Claimed(_, claimed) => self.claim_answered(&id, claimed),
            SimAnswer::Created(Ok(())) => {
                let is_durable = self.keys.contains_key(&id);
                self.check(Invariant::Durable, is_durable, || format!("{id} is created, not kept"));
                true
            }
            SimAnswer::Created(Err(CreateError::NoMemory(full))) => {
                unreachable!("memory has no bound here: {full}")
            }
            SimAnswer::Created(Err(CreateError::Full(full))) => {
                self.full(full, &sent);
                self.note_held();
                self.creating.remove(&id);
                return;
            }
            SimAnswer::Created(Err(CreateError::Closed(at))) => {
                let is_due = at <= self.now;
                self.check(Invariant::Closing, is_due, || format!("{id} is refused before {at}"));
                self.stats.count("refused: closed", 1);
                self.note_held();
                self.creating.remove(&id);
                return;
            }
            SimAnswer::Created(Err(CreateError::Journal(error))) => {
                self.note_held();
                self.creating.remove(&id);
                return self.failure(&id, failed, &error);
            }
            SimAnswer::Started(Ok(())) => {
                let kept = self.episode(&id).is_some_and(|e| !e.waiting || e.end.is_some());
                self.check(Invariant::Durable, kept, || format!("{id}: its start is not kept"));
                self.stats.count("starts", 1);
                true
            }
            SimAnswer::Aborted(Ok(())) => {
                let kept = self.episode(&id).is_some_and(|episode| episode.end.is_some());
                self.check(Invariant::Durable, kept, || format!("{id}: its end is not kept"));
                true
            }
            SimAnswer::State(round, Ok(digest)) => {
                self.stats.count("earlier states", 1);
                let known = self.episode(&id).and_then(|e| e.digests.get(round as usize)).copied();
                self.check(Invariant::Replay, known == Some(digest), || {
                    format!("{id}: another state after {round} rounds")
                });
                false
            }
            SimAnswer::State(round, Err(RecoveryError::Broken { problem, .. })) => {
                let what = format!("{id}: no state after {round} rounds: {problem}");
                return self.broken(Invariant::Replay, what);
            }
            SimAnswer::Acted(acts, outcomes, snapshot) => {
                self.shown(server, &id, &snapshot, (sent.moment, sent.floor), moment);
                let whole = acts.len() == outcomes.len();
                self.check(Invariant::Progress, whole, || format!("{id}: an act has no outcome"));
                let mut acks = false;
                for ((agent, submission), outcome) in acts.iter().zip(outcomes) {
                    acks |= outcome.is_ok();
                    let seen = (server, &*snapshot, moment);
                    self.outcome(&sent, *agent, submission, outcome, seen);
                }
                acks
            }
        };
        self.check(Invariant::NoFalseAck, !(acks && too_late), || {
            format!("{id}: request {number} is acknowledged after a failed commit")
        });
    }

    /// Checks the result of a claim, except failures of the journal; returns whether it was acknowledged.
    fn claim_answered(&mut self, id: &EpisodeId, claimed: Result<Claimed, ClaimError>) -> bool {
        match claimed {
            Ok(Claimed { number, agents }) => {
                let is_kept = self.episode(id).is_some_and(|episode| {
                    let holds = |agent: &AgentId| episode.holders[agent.index()] == Some(number);
                    !agents.is_empty() && agents.iter().all(holds)
                });
                let what = || format!("{id}: claim {number} of {agents:?} is not kept");
                self.check(Invariant::Durable, is_kept, what);
                true
            }
            Err(ClaimError::Over) => {
                let is_over = self.episode(id).is_some_and(|episode| episode.end.is_some());
                self.check(Invariant::TrueRefusals, is_over, || format!("{id} is not over"));
                false
            }
            Err(ClaimError::SeatTaken(taken)) => {
                self.stats.count("refused: seat_taken", 1);
                let is_true = self.episode(id).is_some_and(|episode| match taken {
                    SeatTaken::Seat(agent) => episode.holders[agent.index()].is_some(),
                    SeatTaken::Few { open, wanted } => {
                        open < wanted && episode.count_open() <= open
                    }
                });
                self.check(Invariant::TrueRefusals, is_true, || format!("{id}: {taken}"));
                false
            }
            Err(ClaimError::Journal(_)) => unreachable!("failures are told before"),
        }
    }

    /// Checks that a failure is reported only after a failed commit or a refused job.
    fn failure(&mut self, id: &EpisodeId, failed: bool, error: &StoreError) {
        self.stats.count("refused: unavailable", 1);
        // A server of a cluster may be stopped, excluded or leaving, which makes the failure true.
        let moves = self.is_shared && !self.is_calm;
        let is_true = failed || moves || self.refused.contains(id);
        self.check(Invariant::Progress, is_true, || format!("{id}: {error}, and none failed"));
    }

    /// Checks that the server is full, or was full at some moment since the request was sent.
    fn full(&mut self, full: Full, sent: &Sent) {
        self.stats.count("refused: full", 1);
        let (all, owned) = self.held();
        // The refused request itself took no place.
        let (was, most) = match full {
            Full::Episodes(most) => (sent.held.0.max(all) - 1, most),
            Full::EpisodesOfKey(most) => (sent.held.1.max(owned) - 1, most),
            // All clients have one key, which gets no more places than are free.
            Full::EpisodesOfShare { most, .. } => (2 * (sent.held.0.max(all) - 1), most),
            Full::BytesOfEpisode(_) | Full::BytesOf { .. } | Full::BytesPerSecond { .. } => return,
        };
        self.check(Invariant::Quotas, was >= most, || format!("{full}; it was {was}"));
    }

    fn outcome(
        &mut self,
        sent: &Sent,
        agent: AgentId,
        submission: &Submission,
        outcome: Result<Receipt, ActError>,
        (server, snapshot, moment): (Incarnation, &Snapshot, u64),
    ) {
        let Some(&key) = self.keys.get(&sent.id) else { return };
        let place = (key, submission.round, agent);
        let name = format!("{}: {agent} in round {}", sent.id, submission.round);
        let acked = self.acked.get(&place);
        let known_before = acked.is_some_and(|acked| acked.moment < sent.moment);
        let is_same = |recorded: &RecordedAct| {
            let (sent, kept) = (&submission.decision, &recorded.decision);
            kept.act == sent.act && kept.response == sent.response
        };
        let is_same_as_acked = acked.is_some_and(|acked| is_same(&acked.recorded));
        match outcome {
            Ok(receipt) => {
                let stable = Invariant::StableReceipts;
                let recorded = &receipt.recorded;
                let fits = receipt.round == submission.round
                    && is_same(recorded)
                    && recorded.decision.source == Source::Player;
                self.check(stable, fits, || format!("{name} got the receipt of another act"));
                let acked = self.acked.get(&place);
                let is_stable = acked.is_none_or(|acked| {
                    let may_be_first = !acked.was_first && acked.moment > sent.moment;
                    acked.recorded == *recorded && (receipt.duplicate || may_be_first)
                });
                self.check(stable, is_stable, || format!("{name} got another receipt"));
                let kept = self.episodes.get(&key).and_then(|e| e.act(place.1, agent));
                let is_kept = kept.is_some_and(|kept| {
                    kept.raw == recorded.record && kept.waiting_for == recorded.waiting_for
                });
                self.check(Invariant::Durable, is_kept, || {
                    format!("{name} got a receipt for nothing")
                });
                // A client with a receipt must find the state that belongs to it.
                let is_past = snapshot.status.is_over() || snapshot.world.round() > place.1;
                let shows = is_past || (recorded.waiting_for > 0 && snapshot.has_acted(agent));
                self.check(Invariant::Barrier, shows, || {
                    format!("{name} is not shown to have acted")
                });
                self.stats.count(
                    if receipt.duplicate { "acts confirmed again" } else { "acts acknowledged" },
                    1,
                );
                let was_first = !receipt.duplicate;
                let new = || Acked { recorded: receipt.recorded.clone(), moment, was_first: false };
                self.acked.entry(place).or_insert_with(new).was_first |= was_first;
            }
            Err(ActError::Refused(refusal)) => {
                let forgotten = known_before && is_same_as_acked;
                self.check(Invariant::StableReceipts, !forgotten, || {
                    format!("{name} had a receipt, now {refusal}")
                });
                self.refusal(place, sent, submission, refusal, &name);
            }
            Err(ActError::Busy) => self.stats.count("refused: busy", 1),
            Err(ActError::Journal(error)) => {
                let failed = self.failed.contains_key(&server);
                self.failure(&sent.id.clone(), failed, &error);
            }
        }
    }

    /// Checks that a refusal is true by the durable entries.
    fn refusal(
        &mut self,
        (key, sent_round, agent): SeatRound,
        sent: &Sent,
        submission: &Submission,
        refusal: Refusal,
        name: &str,
    ) {
        let Some(episode) = self.episodes.get(&key) else { return };
        let kept = episode.act(sent_round, agent).filter(|kept| kept.by_player());
        let handed = self.handed.get(&(key, sent_round, agent));
        let arrived = sent.arrived.last().map_or(sent.moment, |arrived| arrived.moment);
        let had_acted = kept.is_some() && handed.is_some_and(|&(_, handed)| handed < arrived);
        let (what, is_true) = match refusal {
            Refusal::RoundAhead { sent, round } => ("refused: round_ahead", sent >= round),
            Refusal::AlreadyActed { .. } => (
                "refused: already_acted",
                kept.is_some_and(|kept| !same(&kept.record, &submission.decision.record(agent, 0))),
            ),
            Refusal::EpisodeOver { escaped: false, .. } => {
                ("refused: episode_over", episode.end.is_some() && !had_acted)
            }
            Refusal::EpisodeOver { escaped: true, .. } => {
                ("refused: escaped", !episode.world.is_alive(agent) && !had_acted)
            }
            Refusal::RoundOver { sent, .. } => {
                let ran_out = episode.act(sent, agent).is_some_and(|kept| !kept.by_player());
                ("refused: round_over", (episode.round() > sent || ran_out) && !had_acted)
            }
            Refusal::NoRoom { .. } => {
                ("refused: no_room", submission.decision.text_bytes() > ACT_BYTES_ALWAYS)
            }
        };
        self.stats.count(what, 1);
        self.check(Invariant::TrueRefusals, is_true, || format!("{name}: {refusal}"));
    }
}
