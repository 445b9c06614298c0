//! The time of day, and when it is in doubt.

use jiff::{SignedDuration, Timestamp};
use swarmbench_clock::{Agreement, Doubt};

fn at(ms: i64) -> Timestamp {
    Timestamp::from_millisecond(ms).expect("a time")
}

fn ms(ms: i64) -> SignedDuration {
    SignedDuration::from_millis(ms)
}

#[test]
fn a_jump_is_doubted_until_it_is_taken_back_or_confirmed() {
    let mut agreement = Agreement::new(at(0));
    assert_eq!(agreement.compare(at(1_000), at(1_000)), None);
    for jump in [2_500, -14_000, 3_600_000, 1_001, -1_001] {
        let doubt = Some(Doubt::Jumped(ms(jump)));
        assert_eq!(agreement.compare(at(2_000), at(2_000 + jump)), doubt);
        assert_eq!(agreement.ahead(), ms(0), "the server's own time continues");
        assert_eq!(agreement.compare(at(3_000), at(3_000)), None);
    }
    agreement.confirm(at(4_000), at(1_000));
    assert_eq!(agreement.ahead(), ms(-3_000));
    assert_eq!(agreement.compare(at(5_000), at(2_000)), None);
    assert_eq!(agreement.compare(at(6_000), at(6_000)), Some(Doubt::Jumped(ms(3_000))));
}

#[test]
fn small_differences_are_followed_slowly() {
    let mut agreement = Agreement::new(at(0));
    for second in 1..=100 {
        assert_eq!(agreement.compare(at(second * 1_000), at(second * 1_000 + 900)), None);
        assert_eq!(agreement.ahead(), ms((second * 10).min(900)));
    }
    // The number of calls makes no difference.
    let mut agreement = Agreement::new(at(0));
    for tick in 1..=1_000 {
        agreement.compare(at(tick), at(tick + 900));
    }
    assert_eq!(agreement.ahead(), ms(10));
}

#[test]
fn a_clock_behind_the_newest_entry_is_doubted_until_it_has_passed_it() {
    let mut agreement = Agreement::new(at(0));
    agreement.not_before(at(5_000));
    assert_eq!(agreement.compare(at(1_000), at(1_000)), Some(Doubt::Behind(at(5_000))));
    assert_eq!(agreement.compare(at(5_000), at(5_000)), None);
    assert_eq!(agreement.compare(at(6_000), at(4_000)), Some(Doubt::Jumped(ms(-2_000))));
    // The clock is corrected.
    let mut agreement = Agreement::new(at(0));
    agreement.not_before(at(5_000));
    assert_eq!(agreement.compare(at(1_000), at(1_000)), Some(Doubt::Behind(at(5_000))));
    assert_eq!(agreement.compare(at(2_000), at(9_000)), None);
    assert_eq!(agreement.ahead(), ms(7_000));
    // An organizer confirms it.
    let mut agreement = Agreement::new(at(0));
    agreement.not_before(at(5_000));
    agreement.confirm(at(1_000), at(1_000));
    assert_eq!(agreement.compare(at(2_000), at(2_000)), None);
}
