//! Quotas: shares of episodes, and bytes of the journal.

use jiff::Timestamp;
use swarmbench::episode::quota::{ACT_BYTES_ALWAYS, Caps, Full, Purpose, Quotas, Whose};
use swarmbench::fair::{Group, Party};
use swarmbench::ids::{CompetitionKey, EpisodeKey};
use swarmbench::keys::OwnerKey;

const CAPS: Caps = Caps {
    episodes_unfinished_max: 6,
    episodes_per_key_max: 2,
    reserved_percent: 0,
    journal_bytes_per_episode_max: 10_000,
    journal_bytes_per_key_max: 15_000,
    journal_bytes_per_key_s_max: 0,
};
const OWN: Party = Party::of(Group::Owner(OwnerKey(7)));
const HOST: Party = Party::SERVER;
const CUP: CompetitionKey = CompetitionKey(1);

fn entrant(competition: i64, owner: i64) -> Party {
    Party::entrant(CompetitionKey(competition), OwnerKey(owner))
}

fn at(seconds: i64) -> Timestamp {
    Timestamp::from_second(1_000_000 + seconds).expect("a time")
}

/// A server in which a party opens episodes until it gets no more.
struct Opener {
    caps: Caps,
    quotas: Quotas,
    next: i64,
}

impl Opener {
    fn of(episodes_unfinished_max: usize, reserved_percent: u32) -> Self {
        let episodes_per_key_max = usize::MAX;
        let caps = Caps { episodes_unfinished_max, episodes_per_key_max, reserved_percent, ..CAPS };
        Self { caps, quotas: Quotas::new(caps), next: 0 }
    }

    fn one(&mut self, party: Party, purpose: Purpose) -> Result<(), Full> {
        self.next += 1;
        self.quotas.admit(EpisodeKey(self.next), party, purpose)
    }

    /// Number of further episodes that the party gets.
    fn all(&mut self, party: Party, purpose: Purpose) -> usize {
        (0..10_000).take_while(|_| self.one(party, purpose).is_ok()).count()
    }
}

#[test]
fn caps_hold_for_a_key_and_for_all() {
    let quotas = Quotas::new(CAPS);
    let admit = |key, party| quotas.admit(EpisodeKey(key), party, Purpose::Usual);
    assert_eq!(admit(1, OWN), Ok(()));
    assert_eq!(admit(2, OWN), Ok(()));
    assert_eq!(admit(3, OWN), Err(Full::EpisodesOfKey(2)));
    assert_eq!([4, 5, 6, 7].map(|key| admit(key, HOST)), [Ok(()); 4]);
    assert_eq!(admit(8, HOST), Err(Full::Episodes(6)));
    quotas.release(EpisodeKey(1));
    quotas.release(EpisodeKey(1));
    assert_eq!(quotas.unfinished(), 5);
    assert_eq!(admit(3, HOST), Ok(()));
    // A recovered episode is not counted twice.
    quotas.note(EpisodeKey(3), HOST);
    assert_eq!(quotas.unfinished(), 6);
}

#[test]
fn groups_share_the_episodes_and_a_newcomer_finds_some() {
    let mut opener = Opener::of(1000, 10);
    let usual = Purpose::Usual;
    // 950 are open to all parties, and 850 of them to parties that have some.
    assert_eq!(opener.all(Party::of_key(Some(OwnerKey(1))), usual), 425);
    assert_eq!(opener.all(Party::of_key(None), usual), 213);
    // Entrants registered by one person, however many, share what one competition has, and get a first game each.
    let entrants: Vec<usize> = (0..50).map(|n| opener.all(entrant(1, n), usual)).collect();
    assert!(entrants.iter().all(|count| *count > 0), "{entrants:?}");
    assert_eq!(entrants.iter().sum::<usize>(), 149, "{entrants:?}");
    assert_eq!(opener.one(entrant(2, 1), usual), Ok(()), "another competition starts");
    // The host's own programs share with nobody, and leave the reserve.
    assert_eq!(opener.all(HOST, usual), 162);
    assert_eq!(opener.one(entrant(3, 1), usual), Err(Full::Episodes(1000)));
    assert_eq!(opener.all(entrant(3, 1), Purpose::NextGame), 1, "a run goes on");
    assert_eq!(opener.all(OWN, Purpose::Organizer), 49);
}

/// Number of episodes that greedy entrants with `parallel` games each hold on a server of the usual size, and number of
/// entrants without any that then get a first game.
fn newcomers(competitions: i64, entrants: i64, parallel: usize) -> (usize, usize) {
    let mut opener = Opener::of(20_000, 10);
    for (cup, number) in (0..entrants).map(|number| (number % competitions, number)) {
        let one = |_: &usize| opener.one(entrant(cup, number), Purpose::Usual).is_ok();
        (0..parallel).take_while(one).for_each(drop);
    }
    let held = opener.quotas.unfinished();
    let first = |number: &i64| opener.one(entrant(0, *number), Purpose::Usual).is_ok();
    (held, (entrants..20_000).take_while(first).count())
}

#[test]
fn greedy_entrants_leave_first_games_to_others() {
    for (competitions, entrants, parallel, expected) in [
        // Without greedy entrants half of all places are for one competition, so that others start.
        (1, 0, 0, (0, 9500)),
        (1, 162, 64, (8524, 5157)),
        (1, 1000, 64, (9362, 4319)),
        (1, 1000, 1, (1000, 8500)),
        // Entrants take what they can get, in many competitions at once.
        (1, 1000, usize::MAX, (9486, 4257)),
        (20, 162, usize::MAX, (17_095, 948)),
        (20, 1000, usize::MAX, (17_933, 509)),
    ] {
        let found = newcomers(competitions, entrants, parallel);
        assert_eq!(found, expected, "{entrants} entrants of {competitions} competitions");
    }
}

#[test]
fn an_entrant_that_has_games_has_no_first_one_however_many_runs_it_starts() {
    let mut opener = Opener::of(100, 10);
    let greedy = opener.all(entrant(1, 1), Purpose::Usual);
    // Each of its runs asks for its next game.
    assert_eq!(opener.all(entrant(1, 1), Purpose::NextGame), 0);
    // Games that end and begin again move no bound.
    for key in 1..=20 {
        opener.quotas.release(EpisodeKey(key));
        opener.one(entrant(1, 1), Purpose::Usual).expect("the place that it gave back");
    }
    assert_eq!(opener.all(entrant(1, 1), Purpose::Usual), 0, "{greedy}");
    assert_eq!(opener.one(entrant(1, 2), Purpose::Usual), Ok(()));
}

#[test]
fn an_entrant_leaves_episodes_to_others_of_the_same_competition() {
    let mut opener = Opener::of(1000, 0);
    let first = opener.all(entrant(1, 1), Purpose::Usual);
    let second = opener.all(entrant(1, 2), Purpose::Usual);
    assert_eq!((first, second), (250, 125));
    let share = opener.one(entrant(1, 1), Purpose::Usual);
    let limit = share.map_err(Full::limit);
    assert_eq!(limit, Err(("episodes_unfinished_max", 1000)));
}

#[test]
fn a_run_goes_on_as_long_as_others_have_half() {
    let mut opener = Opener::of(100, 20);
    let of = |cup, owners: std::ops::Range<i64>| owners.map(move |owner| entrant(cup, owner));
    let mut go_on = |mut parties: Box<dyn Iterator<Item = Party>>| {
        let goes_on = |party: &Party| opener.one(*party, Purpose::NextGame).is_ok();
        parties.by_ref().take_while(goes_on).count()
    };
    assert_eq!(go_on(Box::new(of(1, 0..100))), 50);
    assert_eq!(go_on(Box::new(of(2, 0..100))), 45, "half of the reserve is left");
    assert_eq!(opener.one(entrant(3, 2), Purpose::NextGame), Err(Full::Episodes(100)));
}

/// Decision of [`Quotas`], computed from a list of all open episodes.
fn model(caps: &Caps, open: &[Party], party: Party, purpose: Purpose) -> bool {
    let own = open.iter().filter(|other| **other == party).count();
    let group: Vec<_> = open.iter().filter(|other| other.group == party.group).collect();
    let playing = group.iter().collect::<std::collections::HashSet<_>>().len();
    let all = caps.episodes_unfinished_max;
    let of_all = |percent: u32| all * percent as usize / 100;
    let is_next = purpose == Purpose::NextGame && own == 0;
    let reserved = of_all(caps.reserved_percent) / if is_next { 4 } else { 2 };
    let free = (all - reserved).saturating_sub(open.len());
    let free_for_more = free.saturating_sub(of_all(caps.reserved_percent));
    let is_entrant = matches!(party.group, Group::Competition(_));
    match purpose {
        Purpose::Organizer => open.len() < all,
        Purpose::NextGame | Purpose::Usual if own > 0 => {
            let left = free_for_more.saturating_sub(group.len());
            left > 0 && (!is_entrant || own < left.div_ceil(2))
        }
        Purpose::NextGame => free > 0 && playing < all.div_ceil(2),
        Purpose::Usual => free > 0 && playing < free,
    }
}

proptest::proptest! {
    #[test]
    fn episodes_are_shared_as_by_one_who_counts_all(
        all in 1..80_usize,
        reserved in 0..30_u32,
        steps in proptest::collection::vec((0..5_i64, 0..4_i64, 0..12_u8), 0..200),
    ) {
        let mut opener = Opener::of(all, reserved);
        let caps = opener.caps;
        let mut open: Vec<(EpisodeKey, Party)> = Vec::new();
        for (group, member, what) in steps {
            let own = Party::of(Group::Owner(OwnerKey(100 + group)));
            let party = if group < 3 { entrant(group, member) } else { own };
            let purpose = match what {
                0..7 => Purpose::Usual,
                7..9 => Purpose::NextGame,
                9 => Purpose::Organizer,
                _ => {
                    if let Some(ended) = open.iter().position(|(_, other)| *other == party) {
                        opener.quotas.release(open.swap_remove(ended).0);
                    }
                    opener.quotas.tidy(at(0));
                    continue;
                }
            };
            let parties: Vec<_> = open.iter().map(|(_, party)| *party).collect();
            let is_admitted = opener.one(party, purpose).is_ok();
            proptest::prop_assert_eq!(is_admitted, model(&caps, &parties, party, purpose));
            if is_admitted {
                open.push((EpisodeKey(opener.next), party));
            }
        }
    }
}

#[test]
fn bytes_are_limited_but_small_acts_always_fit() {
    let quotas = Quotas::new(CAPS);
    let (own, cup) = (EpisodeKey(1), EpisodeKey(2));
    quotas.note(own, OWN);
    quotas.note(cup, Party::within(Some(CUP), None));
    let check = |episode, used, more| quotas.check_act(episode, used, more, at(0));
    assert_eq!(check(own, 9_000, 1_000), Ok(()));
    assert_eq!(check(own, 9_000, 3_000), Err(Full::BytesOfEpisode(10_000)));
    assert_eq!(check(own, 99_000, ACT_BYTES_ALWAYS), Ok(()));
    quotas.add_bytes(own, 14_000, at(0));
    assert_eq!(check(own, 0, 3_000), Err(Full::BytesOf { whose: Whose::Key, most: 15_000 }));
    assert_eq!(check(cup, 0, 3_000), Ok(()), "nobody's key, nobody's bytes");
    quotas.note_competition(CUP, 58_000);
    assert_eq!(
        check(cup, 0, 3_000),
        Err(Full::BytesOf { whose: Whose::Competition, most: 60_000 })
    );
    quotas.note_bytes(OwnerKey(7), 1_000);
    assert_eq!(
        quotas.check(OWN, Purpose::Usual),
        Err(Full::BytesOf { whose: Whose::Key, most: 15_000 })
    );
}

#[test]
fn large_acts_come_at_a_pace_and_small_ones_at_any() {
    let most = 10_000;
    let caps = Caps {
        journal_bytes_per_key_s_max: most,
        journal_bytes_per_episode_max: u64::MAX,
        journal_bytes_per_key_max: u64::MAX,
        ..CAPS
    };
    let quotas = Quotas::new(caps);
    for owner in 1..=5 {
        quotas.note(EpisodeKey(owner), entrant(1, owner));
    }
    // Number of acts of 10,000 bytes that an owner gets in.
    let flood = |owner, now| {
        let one = |_: &u32| {
            let fits = quotas.check_act(EpisodeKey(owner), 0, most, now).is_ok();
            if fits {
                quotas.add_bytes(EpisodeKey(owner), most, now);
            }
            fits
        };
        (0..10_000).take_while(one).count()
    };
    let check = |owner, now| quotas.check_act(EpisodeKey(owner), 0, most, now);
    assert_eq!(flood(1, at(0)), 9, "eight seconds' worth, and one more");
    let whose = Whose::Entrant;
    let late = Err(Full::BytesPerSecond { whose, most, after_ms: 1000 });
    assert_eq!(check(1, at(0)), late);
    assert_eq!(quotas.check_act(EpisodeKey(1), 0, ACT_BYTES_ALWAYS, at(0)), Ok(()));
    // Other entrants of the competition write, too, until it is too much together.
    assert_eq!([2, 3, 4].map(|owner| flood(owner, at(0))), [9, 9, 6]);
    let whose = Whose::Competition;
    let late = Err(Full::BytesPerSecond { whose, most: 4 * most, after_ms: 250 });
    assert_eq!(check(5, at(0)), late);
    assert_eq!(flood(5, at(1)), 4);
    assert_eq!(flood(1, at(100)), 9);
    // A clock that was set back lets nobody wait for hours.
    assert_eq!(check(1, at(-3600)), Ok(()));
}
