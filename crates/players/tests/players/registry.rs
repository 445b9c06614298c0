//! Players are found by name.

use swarmbench_engine::TaskName;
use swarmbench_players::{all, default_for, find};

#[test]
fn every_player_is_found_by_its_name_for_its_tasks_alone() {
    for player in all() {
        for task in TaskName::ALL {
            let found = find(player.name, task).map(|found| found.name);
            assert_eq!(found.ok(), player.tasks.contains(&task).then_some(player.name));
        }
        let is_plain = |c: char| c.is_ascii_lowercase() || c == '-';
        assert!(player.name.chars().all(is_plain), "{}", player.name);
        assert!(player.summary.ends_with('.'), "{}", player.summary);
    }
}

#[test]
fn names_are_unique() {
    let mut names: Vec<_> = all().map(|player| player.name).collect();
    names.sort_unstable();
    names.dedup();
    assert_eq!(names.len(), all().count());
}

#[test]
fn every_task_has_a_default_that_is_not_random() {
    for task in TaskName::ALL {
        assert!(default_for(task).tasks.contains(&task));
        assert_ne!(default_for(task).name, "random");
    }
}

#[test]
fn an_unknown_name_is_refused_with_the_known_ones() {
    let refused = find("round-clock", TaskName::Transport).unwrap_err().to_string();
    assert_eq!(
        refused,
        "no built-in player \"round-clock\" plays Transport, only push-and-leave, find-and-push, push-ahead, random"
    );
    let long = find(&"x".repeat(10_000), TaskName::Pursuit).unwrap_err().to_string();
    assert!(long.len() < 200, "{long}");
}
