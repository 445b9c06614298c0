//! Servers that share the database: they come and go, stop and resume, and no two of them play one episode.

use std::sync::Arc;
use std::time::Duration;

use futures::FutureExt as _;
use jiff::SignedDuration;
use swarmbench::cluster::watch::Seen;
use swarmbench::episode::registry::Location;
use swarmbench::ids::{Numbers, Place};
use swarmbench::membership;
use swarmbench::store::entries::Entry;
use swarmbench_clock::Clock as _;
use tokio::sync::watch;

use super::{Peer, SimulationRun, Site};
use crate::simulation::checker::Invariant;
use crate::simulation::clients::SimAnswer;
use swarmbench::cluster::Incarnation;

/// Time that passes without a beat of the running servers.
const BEATS_MISSED: Duration = Duration::from_secs(1);

/// Seconds without any change of servers before the cluster counts as calm: longer than the interval of searches for
/// abandoned work.
const CALM_FOR: usize = 32;

/// Maximum duration until all servers play their own places.
const CALMS_AFTER: Duration = Duration::from_mins(2);

impl SimulationRun {
    /// Starts a server in a free slot.
    pub(super) fn start_one(&mut self, slot: usize) {
        let (number, now) = (i16::try_from(slot).expect("a few"), self.clock.now());
        let incarnation = self.database.tables().join(number, now);
        let journal = Arc::new(self.journal(incarnation.unsigned_abs(), incarnation));
        let keys = Numbers::of_slot(number, self.database.tables().last_key());
        let mut server = self.server(number, Arc::clone(&journal), keys);
        let peer = Arc::new(Peer::new(
            server.registry.clone(),
            journal,
            Arc::clone(&self.clock),
            self.executor.spawner(incarnation),
            SignedDuration::from_secs(self.options.off_s[slot]),
            self.options.flaw,
        ));
        self.net.add(Arc::clone(&peer));
        let site = Arc::new(Site { net: Arc::clone(&self.net), peer: Arc::clone(&peer) });
        let (look, looks) = watch::channel(Seen::default());
        self.executor.spawn_lasting(incarnation, membership::beat(Arc::clone(&site), look).boxed());
        self.executor.spawn_lasting(incarnation, membership::work(site, looks).boxed());
        server.peer = Some(peer);
        self.servers.push(server);
        self.note(format!("server {incarnation} starts"));
        self.checker.stats.count("servers started", 1);
        self.look();
    }

    /// Removes the process of a server. A commit that it has sent may be executed all the same.
    pub(super) fn crash_one(&mut self, place: usize) {
        self.crashes += 1;
        let (incarnation, journal) = {
            let server = &self.servers[place];
            (server.incarnation, Arc::clone(&server.journal))
        };
        self.note(format!("server {incarnation} falls over"));
        if journal.queued() > 0 && !journal.has_failed() && self.dice.below(2) == 0 {
            let jobs = 1 + self.dice.below(journal.queued().min(self.options.group));
            self.commit(place, jobs);
        }
        self.checker.stats.count("crashes", 1);
        self.remove(place);
    }

    fn remove(&mut self, place: usize) {
        let server = self.servers.remove(place);
        self.net.remove(server.incarnation);
        self.executor.crash(server.incarnation);
        // Unwritten jobs are lost.
        drop(server.journal.crash());
        self.checker.gone(server.incarnation, &self.database.tables().durable);
        self.down.push(server.slot);
        drop(server);
        self.look();
    }

    /// Stops a server abruptly, until it is resumed.
    pub(super) fn stop(&mut self, place: usize) {
        self.stops += 1;
        let is_sent = self.dice.below(2) == 0;
        let server = &mut self.servers[place];
        server.is_sent = is_sent;
        let incarnation = server.incarnation;
        self.executor.stop(incarnation);
        self.note(format!("server {incarnation} is stopped, a commit is sent: {is_sent}"));
        self.checker.stats.count("servers stopped", 1);
    }

    pub(super) fn go_on(&mut self, place: usize) {
        let incarnation = self.servers[place].incarnation;
        self.servers[place].is_sent = false;
        self.executor.go_on(incarnation);
        self.note(format!("server {incarnation} goes on"));
        if !self.database.tables().knows(incarnation) {
            self.checker.stats.count("woken after a take-over", 1);
        }
    }

    /// Lets a server accept no more requests and no more work.
    pub(super) fn shut(&mut self, place: usize) {
        self.leaves += 1;
        if let Some(peer) = &self.servers[place].peer {
            peer.shut();
        }
        self.note(format!("server {} is to leave", self.servers[place].incarnation));
    }

    /// Lets a server leave, whose jobs are all durable.
    pub(super) fn quit(&mut self, place: usize) {
        let incarnation = self.servers[place].incarnation;
        self.database.tables().delete(incarnation);
        self.note(format!("server {incarnation} leaves"));
        self.checker.stats.count("servers that left", 1);
        self.remove(place);
    }

    /// Lets running servers beat when much time passes. Sometimes none does.
    pub(super) fn stay_alive(&mut self, by: Duration) {
        if by <= BEATS_MISSED || (!self.is_calm && self.dice.below(16) == 0) {
            return;
        }
        for server in self.servers.iter().filter(|server| self.runs(server)) {
            let Some(peer) = &server.peer else { continue };
            let (at, is_ready) = (peer.lease_clock(), !peer.is_shut());
            if self.database.tables().beat(server.incarnation, at, is_ready) {
                peer.lease.renew(peer.time());
            }
        }
    }

    // ---- invariants

    /// Checks that a server that writes an episode owns its place.
    pub(super) fn check_writer(&mut self, writer: Incarnation, entries: &[Entry]) {
        for episode in entries.iter().filter_map(Entry::chain) {
            let owner = self.database.tables().owner(Place::Game(episode));
            self.checker.check(Invariant::OneOwner, owner == Some(writer), || {
                format!("{}: server {writer} writes, {owner:?} plays it", episode.0)
            });
        }
    }

    /// Checks that no two servers that may still write or answer play at one place.
    pub(super) fn check_owners(&mut self) {
        let mut wrong = Vec::new();
        let (excluded, taken) = {
            let tables = self.database.tables();
            let known: Vec<Incarnation> = tables.servers().map(|(number, ..)| number).collect();
            let excluded = self.known.iter().filter(|server| !known.contains(server)).copied();
            let excluded: Vec<Incarnation> = excluded.collect();
            self.known = known;
            (excluded, tables.places().collect::<Vec<_>>())
        };
        for (place, owner) in taken {
            for server in self.servers.iter().filter(|server| server.incarnation != owner) {
                let Some(peer) = &server.peer else { continue };
                let may_write = self.known.contains(&server.incarnation);
                if server.journal.places().has(place)
                    && (may_write || peer.may_answer())
                    && self.database.tables().is_unfinished(place)
                {
                    wrong.push(format!(
                        "{place:?}: servers {owner} and {} play it",
                        server.incarnation
                    ));
                }
            }
        }
        for server in excluded {
            self.note(format!("server {server} is excluded"));
            self.checker.excluded(server);
        }
        for what in wrong {
            self.checker.check(Invariant::OneOwner, false, || what);
        }
    }

    // ---- the end of a run

    /// Starts all servers, resumes stopped ones, and waits until each plays its own places.
    pub(super) fn calm_down(&mut self) {
        self.is_calm = true;
        let until = self.clock.now() + SignedDuration::try_from(CALMS_AFTER).expect("minutes");
        let mut calm = 0;
        // Long enough for a search for abandoned work, and for the answer to a client.
        while calm < CALM_FOR && self.clock.now() < until {
            while let Some(&place) = self.stopped().first() {
                self.go_on(place);
            }
            self.drain();
            calm += 1;
            let lost = self.that(|server| {
                server.journal.has_failed()
                    || server.peer.as_ref().is_some_and(|peer| peer.is_shut())
            });
            if let Some(&place) = lost.first() {
                self.crash_one(place);
                calm = 0;
            }
            while let Some(slot) = self.down.pop() {
                self.start_one(slot.unsigned_abs().into());
                calm = 0;
            }
            self.pass(Duration::from_secs(1));
            if calm >= CALM_FOR && !self.pending.is_empty() {
                calm = CALM_FOR - 1;
            }
        }
        self.drain();
        self.checker.calm();
        self.check_continued();
    }

    /// Checks that the owner of an unfinished episode continues it without a request.
    fn check_continued(&mut self) {
        let unfinished = self.database.tables().unfinished();
        for one in unfinished {
            // A place that was given up waits for another server's next search.
            let owner = self.database.tables().owner(Place::Game(one.episode));
            let Some(owner) = owner else { continue };
            let continues = self.servers.iter().any(|server| {
                server.incarnation == owner
                    && server.registry.location(&one.id) != Location::Journal
            });
            self.checker.check(Invariant::Progress, continues, || {
                format!("{}: server {owner} has it, and does not continue it", one.id)
            });
        }
    }

    /// Crashes a server and starts it again.
    pub(super) fn crash_and_start(&mut self) {
        let all = self.that(|_| true);
        if let Some(place) = self.one_of(&all) {
            self.crash_one(place);
        }
        while let Some(slot) = self.down.pop() {
            self.start_one(slot.unsigned_abs().into());
        }
        // Clients may send requests before the start.
        for _ in 0..self.dice.below(4) {
            self.drain();
            self.pass(Duration::from_millis(500));
        }
    }
}

/// True if a server answers so from the episodes that it plays.
pub(super) const fn is_played(answer: &SimAnswer) -> bool {
    matches!(
        answer,
        SimAnswer::Acted(..)
            | SimAnswer::Claimed(_, Ok(_))
            | SimAnswer::Started(Ok(()))
            | SimAnswer::Aborted(Ok(()))
            | SimAnswer::State(_, Ok(_))
    )
}
