//! The campaign: the real server, the real disk, many clients; and then the server is killed, told to stop, or
//! its disk breaks. Whatever was acknowledged must be there afterwards. See `docs/develop/campaign.md`.
//!
//! Most other tests have a clock of their own. Here a process is killed at moments that nobody chose, so time is the host's, and what
//! is waited for has a limit after which the test fails.

mod audit;
mod away;
mod clients;
mod cluster;
#[cfg(target_os = "linux")]
mod disk;
mod doors;
mod forks;
mod kills;
mod ledger;
mod plan;
#[cfg(target_os = "linux")]
mod preload;
mod proxy;
mod stop;

use std::sync::PoisonError;

use libtest_mimic::Trial;
use swarmbench_testkit::postgres;

use self::cluster::refusals;
use crate::PROCESSORS;

/// All tests of the campaign. Those of SQLite's files are ignored where the tests run on PostgreSQL, those that need it where
/// they do not.
pub(crate) fn tests() -> Vec<Trial> {
    let on_postgres = postgres::is_asked();
    let mut tests = vec![
        test(
            "kills::what_was_acknowledged_survives_every_kill",
            true,
            kills::what_was_acknowledged_survives_every_kill,
        ),
        test(
            "forks::forks_are_there_whole_or_not_at_all",
            true,
            forks::forks_are_there_whole_or_not_at_all,
        ),
        test("stop::games_go_on_after_every_stop", true, stop::games_go_on_after_every_stop),
        test(
            "stop::whoever_waits_is_answered_in_full",
            true,
            stop::whoever_waits_is_answered_in_full,
        ),
        test(
            "stop::a_client_that_never_ends_its_request_holds_nobody_up",
            true,
            stop::a_client_that_never_ends_its_request_holds_nobody_up,
        ),
        test(
            "stop::acts_that_came_while_the_process_was_frozen_are_in_time",
            true,
            stop::acts_that_came_while_the_process_was_frozen_are_in_time,
        ),
        test(
            "away::a_database_that_goes_away_is_a_pause",
            on_postgres,
            away::a_database_that_goes_away_is_a_pause,
        ),
        test(
            "cluster::servers_lose_nothing_and_play_nothing_twice",
            on_postgres,
            cluster::servers_lose_nothing_and_play_nothing_twice,
        ),
        test(
            "cluster::a_server_that_does_not_fit_says_why_and_ends",
            on_postgres,
            refusals::a_server_that_does_not_fit_says_why_and_ends,
        ),
        test(
            "cluster::a_dead_server_at_the_address_of_another_keeps_nobody_out",
            on_postgres,
            refusals::a_dead_server_at_the_address_of_another_keeps_nobody_out,
        ),
        test(
            "cluster::a_server_with_a_wrong_clock_does_not_join",
            on_postgres,
            refusals::a_server_with_a_wrong_clock_does_not_join,
        ),
        test(
            "cluster::a_server_whose_clock_goes_wrong_leaves_its_work_to_the_others",
            on_postgres,
            refusals::a_server_whose_clock_goes_wrong_leaves_its_work_to_the_others,
        ),
        test(
            "cluster::a_server_whose_commits_are_lost_leaves_its_work_to_the_others",
            on_postgres,
            refusals::a_server_whose_commits_are_lost_leaves_its_work_to_the_others,
        ),
        test(
            "cluster::an_older_server_and_a_cluster_exclude_each_other",
            on_postgres && refusals::has_old_program(),
            refusals::an_older_server_and_a_cluster_exclude_each_other,
        ),
    ];
    #[cfg(target_os = "linux")]
    {
        for (name, kind, mends) in disk::FAILURES {
            let name = format!("disk::nothing_is_acknowledged_after_a_failed_commit::{name}");
            let play = move || disk::nothing_is_acknowledged_after_a_failed_commit(kind, mends);
            tests.push(test(&name, !on_postgres, play));
        }
        tests.push(test(
            "disk::writes_that_take_only_a_part_do_no_harm",
            !on_postgres,
            disk::writes_that_take_only_a_part_do_no_harm,
        ));
        let may_mount = rustix::process::geteuid().is_root();
        tests.push(test(
            "disk::a_disk_that_is_really_full",
            !on_postgres && may_mount,
            disk::a_disk_that_is_really_full,
        ));
    }
    tests
}

/// A test that is ignored where it cannot run.
fn test<F: Future<Output = ()>>(
    name: &str,
    can_run: bool,
    play: impl FnOnce() -> F + Send + 'static,
) -> Trial {
    let run = || {
        let _shared = PROCESSORS.read().unwrap_or_else(PoisonError::into_inner);
        let runtime =
            tokio::runtime::Builder::new_multi_thread().worker_threads(2).enable_all().build();
        runtime.expect("a runtime").block_on(play());
        Ok(())
    };
    Trial::test(format!("campaign::{name}"), run).with_ignored_flag(!can_run)
}
