//! A server's watch over its cluster: when it beats, who is dead, and what it does about places of others.
//!
//! Observations and their time go in, due work comes out.

use std::collections::HashMap;
use std::sync::Arc;
use std::time::Duration;

use super::{ANSWERS_FOR, Incarnation, ServerRow, TAKEN_OVER_AFTER};

/// Interval between looks at the other servers.
pub const LOOKS_EVERY: Duration = Duration::from_millis(250);

/// Looks per beat, with which this server shows that it is alive.
const LOOKS_PER_BEAT: u32 = 4;

/// Interval between searches for unowned places while no server comes or goes.
const SEARCHES_EVERY: Duration = Duration::from_secs(30);

/// Interval between releases of places that other servers are preferred for, or where everything has ended.
const TIDIES_EVERY: Duration = Duration::from_secs(10);

/// Interval between deletions of old changes.
const DELETES_EVERY: Duration = Duration::from_mins(5);

/// Time for which this server's clock may be too far from the database's before the server leaves its places to others.
const CLOCK_OFF_PATIENCE: Duration = Duration::from_secs(10);

/// The last look at the cluster.
#[derive(Clone, Debug, Default)]
pub struct Seen {
    pub servers: Arc<[ServerRow]>,
    /// Time since which the database has answered every look; `None` while it does not answer.
    pub up_since: Option<Duration>,
}

/// Looks of this server at its cluster.
#[derive(Debug, Default)]
pub struct Looks {
    number: u32,
    up_since: Option<Duration>,
    off_since: Option<Duration>,
}

/// State of this server's clock at the last look.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ClockSeen {
    Right,
    /// Too far from the database's. `is_new` since this look.
    Off {
        is_new: bool,
    },
    /// Off for too long, while the clock of a server that takes places is right.
    OffForTooLong,
}

impl Looks {
    /// Whether the next look comes with a beat.
    pub fn beats(&mut self) -> bool {
        let beats = self.number.is_multiple_of(LOOKS_PER_BEAT);
        self.number = self.number.wrapping_add(1);
        beats
    }

    /// The database has answered.
    pub fn answered(&mut self, servers: Arc<[ServerRow]>, now: Duration) -> Seen {
        Seen { servers, up_since: Some(*self.up_since.get_or_insert(now)) }
    }

    /// The database has not answered; returns whether that is new.
    pub fn failed(&mut self) -> bool {
        self.up_since.take().is_some() || self.number == 1
    }

    /// This server's clock. Where all clocks are off, the database's is.
    pub fn clock(&mut self, servers: &[ServerRow], me: Incarnation, now: Duration) -> ClockSeen {
        let Some(own) = servers.iter().find(|row| row.incarnation == me && row.is_off()) else {
            self.off_since = None;
            return ClockSeen::Right;
        };
        let is_heir = |one: &ServerRow| {
            one.incarnation != own.incarnation && one.is_ready && one.is_connected && !one.is_off()
        };
        let is_new = self.off_since.is_none();
        let since = *self.off_since.get_or_insert(now);
        if now.saturating_sub(since) >= CLOCK_OFF_PATIENCE && servers.iter().any(is_heir) {
            ClockSeen::OffForTooLong
        } else {
            ClockSeen::Off { is_new }
        }
    }
}

/// Evidence against a server.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Suspicion {
    /// No beat for so long that it answers nothing any more: it is excluded.
    Expired,
    /// No session in the database: it is excluded if its process is gone.
    Away,
}

/// Work that is due after a look.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Due {
    pub suspects: Vec<(Incarnation, Suspicion)>,
    pub duties: Vec<Duty>,
}

/// Something that a server does now and then.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Duty {
    /// Take the unowned places that this server is preferred for, and say so with [`Work::adopted`].
    Adopt,
    /// Release places where everything has ended, and idle ones that other servers are preferred for.
    Tidy,
    DeleteOldChanges,
    /// Be ready: this server only forwards, and others take places.
    BeReady,
}

/// A server's work for places of others.
#[derive(Debug)]
pub struct Work {
    me: Incarnation,
    forwards_only: bool,
    /// The last beats of the other servers, and since when they are the last. The database's clock alone could be set forward.
    beats: HashMap<Incarnation, (i64, Duration)>,
    /// Servers that take places, and all servers, when unowned places were searched last, and when that was.
    searched: Option<(Composition, Duration)>,
    tidied: Duration,
    deleted: Duration,
}

/// Servers that take places, and all servers. A change of either starts a search: a server that took no more places leaves some
/// behind, too.
type Composition = (Vec<Incarnation>, Vec<Incarnation>);

fn composition(servers: &[ServerRow]) -> Composition {
    let ready = servers.iter().filter(|row| row.is_ready).map(|row| row.incarnation);
    (ready.collect(), servers.iter().map(|row| row.incarnation).collect())
}

impl Work {
    pub fn new(me: Incarnation, forwards_only: bool, now: Duration) -> Self {
        Self { me, forwards_only, beats: HashMap::new(), searched: None, tidied: now, deleted: now }
    }

    /// Work that is due after a look at which the database answered.
    pub fn due(&mut self, seen: &Seen, now: Duration) -> Due {
        let Some(up_since) = seen.up_since else { return Due::default() };
        self.note_beats(&seen.servers, now);
        let others = seen.servers.iter().filter(|row| row.incarnation != self.me);
        let suspects = others.filter_map(|row| {
            let suspicion = self.suspicion(row, up_since, now)?;
            Some((row.incarnation, suspicion))
        });
        let suspects = suspects.collect();
        let composition = composition(&seen.servers);
        let ready = &composition.0;
        if !ready.contains(&self.me) {
            let is_ready = self.forwards_only && !ready.is_empty();
            return Due {
                suspects,
                duties: is_ready.then_some(Duty::BeReady).into_iter().collect(),
            };
        }
        let is_oldest = ready.first() == Some(&self.me);
        let adopts = self.searched.as_ref().is_none_or(|(last, at)| {
            *last != composition || now.saturating_sub(*at) >= SEARCHES_EVERY
        });
        let duties = [
            (Duty::Adopt, adopts),
            (Duty::Tidy, is_over(&mut self.tidied, TIDIES_EVERY, now)),
            (Duty::DeleteOldChanges, is_oldest && is_over(&mut self.deleted, DELETES_EVERY, now)),
        ];
        let due = duties.into_iter().filter_map(|(duty, is_due)| is_due.then_some(duty));
        Due { suspects, duties: due.collect() }
    }

    /// Unowned places were searched and taken after this look; returns whether for the first time.
    pub fn adopted(&mut self, seen: &Seen, now: Duration) -> bool {
        self.searched.replace((composition(&seen.servers), now)).is_none()
    }

    fn note_beats(&mut self, servers: &[ServerRow], now: Duration) {
        let last = std::mem::take(&mut self.beats);
        let seen = servers.iter().map(|row| {
            let (number, beat_at) = (row.incarnation, row.beat_at_ms);
            let same = last.get(&number).filter(|(last, _)| *last == beat_at);
            (number, (beat_at, same.map_or(now, |(_, since)| *since)))
        });
        self.beats = seen.collect();
    }

    fn suspicion(&self, row: &ServerRow, up_since: Duration, now: Duration) -> Option<Suspicion> {
        // Negative while a server starts.
        let is_expired = i128::from(row.seen_ms_ago) > TAKEN_OVER_AFTER.as_millis().cast_signed();
        let last = self.beats.get(&row.incarnation);
        let is_silent = last.is_some_and(|(_, since)| now.saturating_sub(*since) > ANSWERS_FOR);
        // While the database was away, no server could beat.
        let could_beat = now.saturating_sub(up_since) > TAKEN_OVER_AFTER;
        if is_expired && is_silent && could_beat {
            Some(Suspicion::Expired)
        } else if row.is_connected {
            None
        } else {
            Some(Suspicion::Away)
        }
    }
}

/// Whether an interval is over, which begins anew then.
fn is_over(since: &mut Duration, interval: Duration, now: Duration) -> bool {
    let is_over = now.saturating_sub(*since) >= interval;
    if is_over {
        *since = now;
    }
    is_over
}

#[cfg(test)]
mod tests {
    use super::*;

    const ME: Incarnation = 1;

    fn row(incarnation: Incarnation, clock_offset_ms: i64) -> ServerRow {
        ServerRow {
            incarnation,
            address: "127.0.0.1:7000".to_owned(),
            name: "a machine, process 1".to_owned(),
            version: "1".to_owned(),
            joined_at_ms: 0,
            beat_at_ms: 0,
            seen_ms_ago: 0,
            is_connected: true,
            clock_offset_ms,
            is_ready: true,
            episodes: 0,
            places: 0,
        }
    }

    /// Whether a server that sees these servers for so long leaves its places.
    fn leaves(servers: &[ServerRow], seconds: u64) -> bool {
        let mut looks = Looks::default();
        let mut seen = (0..=seconds).map(Duration::from_secs);
        seen.any(|now| looks.clock(servers, ME, now) == ClockSeen::OffForTooLong)
    }

    #[test]
    fn a_server_whose_clock_stays_off_leaves_its_places_to_one_whose_clock_is_right() {
        let patience = CLOCK_OFF_PATIENCE.as_secs();
        let (off, right) = (row(ME, -501), row(2, 500));
        assert!(leaves(&[off.clone(), right.clone()], patience));
        assert!(!leaves(&[off.clone(), right.clone()], patience - 1), "it may come back");
        assert!(!leaves(&[row(ME, 500), right.clone()], 1000));
        for nobody in [
            row(2, 501),
            ServerRow { is_ready: false, ..right.clone() },
            ServerRow { is_connected: false, ..right },
        ] {
            assert!(!leaves(&[off.clone(), nobody], 1000), "nobody would play on");
        }
        assert!(!leaves(&[off], 1000), "nobody would play on");
    }

    #[test]
    fn a_clock_that_was_right_in_between_is_off_anew() {
        let (mut looks, right) = (Looks::default(), row(2, 0));
        for second in 0..1000 {
            let offset = if second % 9 == 0 { 0 } else { 60_000 };
            let servers = [row(ME, offset), right.clone()];
            let seen = looks.clock(&servers, ME, Duration::from_secs(second));
            let expected = match second % 9 {
                0 => ClockSeen::Right,
                rest => ClockSeen::Off { is_new: rest == 1 },
            };
            assert_eq!(seen, expected, "{second}");
        }
    }

    #[test]
    fn a_look_in_four_comes_with_a_beat_and_silence_of_the_database_is_told_once() {
        let mut looks = Looks::default();
        let beats: Vec<bool> = (0..8).map(|_| looks.beats()).collect();
        assert_eq!(beats, [true, false, false, false, true, false, false, false]);
        looks.answered(Arc::default(), Duration::ZERO);
        assert!(looks.failed());
        assert!(!looks.failed());
        let seen = looks.answered(Arc::default(), Duration::from_secs(9));
        assert_eq!(seen.up_since, Some(Duration::from_secs(9)));
    }

    fn seen<const N: usize>(servers: [ServerRow; N], up_since_s: u64) -> Seen {
        Seen { servers: servers.into(), up_since: Some(Duration::from_secs(up_since_s)) }
    }

    #[test]
    fn a_server_is_suspected_by_its_age_in_the_database_and_by_its_silence_here() {
        let now = Duration::from_secs(100);
        let old = ServerRow { seen_ms_ago: 6_001, ..row(2, 0) };
        let mut work = Work::new(ME, false, Duration::ZERO);
        assert_eq!(work.due(&seen([old.clone()], 0), now).suspects, [], "seen for the first time");
        let later = now + ANSWERS_FOR + Duration::from_millis(1);
        let due = work.due(&seen([old.clone()], 0), later);
        assert_eq!(due.suspects, [(2, Suspicion::Expired)]);
        let due = work.due(&seen([old.clone()], 99), later);
        assert_eq!(due.suspects, [], "no server could beat while the database was away");
        let beats = ServerRow { beat_at_ms: 1, ..old.clone() };
        assert_eq!(work.due(&seen([beats], 0), later).suspects, [], "the database's clock was set");
        let young = ServerRow { seen_ms_ago: 6_000, ..old };
        let away = ServerRow { is_connected: false, ..young.clone() };
        assert_eq!(work.due(&seen([young], 0), later * 2).suspects, []);
        assert_eq!(work.due(&seen([away], 0), later * 2).suspects, [(2, Suspicion::Away)]);
    }

    #[test]
    fn places_are_searched_when_a_server_comes_or_goes_and_now_and_then() {
        let (own, other) = (row(ME, 0), row(2, 0));
        let both = seen([own.clone(), other.clone()], 0);
        let mut work = Work::new(ME, false, Duration::ZERO);
        let second = Duration::from_secs(1);
        let adopts =
            |work: &mut Work, seen: &Seen, now| work.due(seen, now).duties.contains(&Duty::Adopt);
        assert!(adopts(&mut work, &both, second));
        assert!(adopts(&mut work, &both, second), "until it is done");
        assert!(work.adopted(&both, second));
        assert!(!adopts(&mut work, &both, second));
        assert!(adopts(&mut work, &seen([own.clone()], 0), second));
        let stops = ServerRow { is_ready: false, ..other };
        assert!(adopts(&mut work, &seen([own, stops], 0), second));
        assert!(!work.adopted(&both, second), "not for the first time");
        assert!(adopts(&mut work, &both, second + SEARCHES_EVERY));
    }

    #[test]
    fn a_server_that_takes_no_places_has_no_duties_but_to_be_ready() {
        let (own, other) = (ServerRow { is_ready: false, ..row(ME, 0) }, row(2, 0));
        let now = Duration::from_secs(1000);
        let mut forwards = Work::new(ME, true, Duration::ZERO);
        let both = seen([own.clone(), other], 0);
        assert_eq!(forwards.due(&both, now).duties, [Duty::BeReady]);
        assert_eq!(forwards.due(&seen([own], 0), now).duties, []);
        assert_eq!(Work::new(ME, false, Duration::ZERO).due(&both, now).duties, []);
    }

    #[test]
    fn the_oldest_server_that_takes_places_deletes_old_changes() {
        let now = DELETES_EVERY;
        let all = seen([row(ME, 0), row(2, 0)], 0);
        let mut oldest = Work::new(ME, false, Duration::ZERO);
        let duties = oldest.due(&all, now).duties;
        assert_eq!(duties, [Duty::Adopt, Duty::Tidy, Duty::DeleteOldChanges]);
        assert_eq!(oldest.due(&all, now).duties, [Duty::Adopt]);
        let duties = Work::new(2, false, Duration::ZERO).due(&all, now).duties;
        assert_eq!(duties, [Duty::Adopt, Duty::Tidy]);
    }
}
