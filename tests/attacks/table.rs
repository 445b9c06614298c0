//! The final report, and what must hold.

use std::time::Duration;

use swarmbench_testkit::latencies::Spread;

use crate::attacks::attackers::{Attack, CPU_SHARE};
use crate::attacks::bout::{Outcome, Phase, Setting};

/// Memory that a server may have resident under any attack beside twice its `--memory-max`, in MiB: the program, its
/// threads, and the pages of the database.
const MEMORY_RESERVE_MIB: u64 = 64;

/// A server that is started again may have more resident than the one before it, by this, in MiB: it meets the same games
/// in another order.
const AGAIN_RESERVE_MIB: u64 = 32;

/// Beside attackers the 99th percentile of an act's receipt is at most this many times what it is alone, and as many
/// milliseconds more.
const FACTOR: f64 = 2.0;
const MORE_MS: f64 = 20.0;

/// In this time a server that was killed is ready again.
const READY: Duration = Duration::from_secs(5);

const KINDS: [&str; 3] = ["/act", "/act?wait", "/swarm/act"];

/// Deviations from the rules for an attack; those of times only in a long run.
pub(crate) fn problems(attack: &Attack, outcome: &Outcome, setting: Setting) -> Vec<String> {
    let is_long = setting.is_long;
    let mut problems = Vec::new();
    let mut check = |is_so: bool, told: String| {
        if is_so {
            problems.push(told);
        }
    };
    if let Some(error) = &outcome.not_played {
        check(true, format!("it was not played: {error}"));
    }
    if let Some(status) = &outcome.died {
        check(true, format!("the server ended: {status}"));
    }
    // An attack that cannot begin says nothing.
    for note in outcome.attackers.notes.iter().filter(|note| note.contains(" gave up: ")) {
        check(true, note.clone());
    }
    let alone = &outcome.alone;
    check(alone.begun != alone.finished, format!("alone, too: {}", alone.failures.join("; ")));
    let Phase { begun, finished, moves_lost, failures, .. } = &outcome.beside;
    check(begun != finished, format!("{finished} of {begun} honest games were finished"));
    check(*begun == 0, "no honest game was begun".to_owned());
    check(*moves_lost > 0, format!("{moves_lost} honest acts came when the round was over"));
    // All kinds at once fill a small machine, where a refused export says more of the machine than of the server.
    let may_refuse = attack.name == "everything" && !is_long;
    let is_refusal = |failure: &&String| may_refuse && failure.contains(": 503 overloaded ");
    let failures: Vec<&str> =
        failures.iter().filter(|failure| !is_refusal(failure)).map(String::as_str).collect();
    check(!failures.is_empty(), format!("honest requests failed: {}", failures.join("; ")));
    let most = 2 * setting.memory_mib(attack) + MEMORY_RESERVE_MIB;
    let (peak, again) = (outcome.memory_peak_mib, outcome.memory_again_mib);
    check(peak.max(again) > most, format!("{} MiB were resident; at most {most}", peak.max(again)));
    check(
        again > peak + AGAIN_RESERVE_MIB,
        format!("a new start took {again} MiB, and the server before it {peak}"),
    );
    let nameless = outcome.attackers.counts.nameless();
    check(!nameless.is_empty(), format!("refusals name no limit: {nameless:?}"));
    // Otherwise the times say nothing.
    let share = outcome.attackers.cpu_s / outcome.attackers.seconds.max(0.001);
    check(share > CPU_SHARE * 1.1, format!("the attackers had {share:.2} of a core"));
    let faults = &outcome.faults;
    check(
        !faults.is_empty(),
        format!("the log has {} errors, first {:?}", faults.len(), faults.first()),
    );
    if is_long {
        for (kind, (alone, beside)) in
            KINDS.iter().zip(outcome.alone.acts.iter().zip(outcome.beside.acts))
        {
            let most = alone.p99_ms * FACTOR + MORE_MS;
            let is = beside.p99_ms;
            check(
                is > most,
                format!("{kind}: p99 is {is:.1} ms beside attackers, at most {most:.1} ms"),
            );
        }
        if let Some(most) = attack.creation_ms_max {
            let is = creation_ms(outcome);
            check(
                is > most,
                format!("a creation costs {is:.1} ms of a processor, at most {most} ms"),
            );
        }
        if let Some(taken) = outcome.ready_again {
            check(taken > READY, format!("ready again after {taken:.1?}, at most {READY:.1?}"));
        }
    }
    problems
}

/// Processor time of the server for a creation by the attackers, without the share of the honest entrant alone.
fn creation_ms(outcome: &Outcome) -> f64 {
    let (alone, beside) = (&outcome.alone, &outcome.beside);
    let of_honest = alone.server_cpu_s / alone.seconds.max(0.001) * beside.seconds;
    let created = outcome.attackers.counts.kinds.get("201").copied().unwrap_or_default();
    (beside.server_cpu_s - of_honest).max(0.0) * 1000.0 / rate(created.max(1), 1.0)
}

/// Reports one attack, with everything that was counted.
pub(crate) fn tell(outcome: &Outcome, problems: &[String]) {
    for (name, phase) in [("alone", &outcome.alone), ("beside attackers", &outcome.beside)] {
        println!("  {name}, {:.1} s:", phase.seconds);
        for (kind, spread) in KINDS.iter().zip(&phase.acts) {
            println!("    {kind}: {}", spread_of(spread));
        }
        println!("    /healthz on a new connection: {}", spread_of(&phase.health));
        println!(
            "    games {} of {}; errands at most: {}",
            phase.finished, phase.begun, phase.errands
        );
        println!("    answers: {}", phase.answers);
        println!("    the server's processor time: {:.1} s", phase.server_cpu_s);
    }
    let attackers = &outcome.attackers;
    println!(
        "  attackers: {:.0} answers/s, {:.1} MB/s sent, {:.1} MB/s received, {:.2} of a core",
        rate(attackers.counts.requests(), attackers.seconds),
        rate(attackers.counts.bytes_sent, attackers.seconds) / 1e6,
        rate(attackers.counts.bytes_received, attackers.seconds) / 1e6,
        attackers.cpu_s / attackers.seconds.max(0.001)
    );
    println!("    answers: {}", attackers.counts.shown());
    for note in &attackers.notes {
        println!("    {note}");
    }
    println!("  most memory resident: {}", memory(outcome));
    if let Some(taken) = outcome.ready_again {
        println!("  ready again {taken:.1?} after the start");
    }
    for problem in problems {
        println!("  NOT SO: {problem}");
    }
}

/// The table of all attacks.
pub(crate) fn show(rows: &[(&str, Outcome, Vec<String>)]) {
    println!(
        "\n| attack | attackers: answers/s | MB/s | refused | honest p99 alone (act, wait, swarm) | beside | most | games | /healthz p99 | server's cores | memory | |"
    );
    println!("| --- | ---: | ---: | ---: | --- | --- | ---: | ---: | ---: | ---: | ---: | --- |");
    for (name, outcome, problems) in rows {
        let (attackers, beside) = (&outcome.attackers, &outcome.beside);
        let bytes = attackers.counts.bytes_sent + attackers.counts.bytes_received;
        let most = beside.acts.iter().map(|spread| spread.max_ms).fold(0.0, f64::max);
        println!(
            "| {name} | {:.0} | {:.1} | {} | {} | {} | {most:.0} ms | {} of {} | {:.0} ms | {:.2} | {} | {} |",
            rate(attackers.counts.requests(), attackers.seconds),
            rate(bytes, attackers.seconds) / 1e6,
            attackers.counts.refused(),
            p99s(&outcome.alone),
            p99s(beside),
            beside.finished,
            beside.begun,
            beside.health.p99_ms,
            beside.server_cpu_s / beside.seconds.max(0.001),
            memory(outcome),
            if problems.is_empty() { "holds".to_owned() } else { problems.join("; ") }
        );
    }
}

fn p99s(phase: &Phase) -> String {
    let millis: Vec<_> = phase.acts.iter().map(|spread| format!("{:.0}", spread.p99_ms)).collect();
    format!("{} ms", millis.join(", "))
}

fn spread_of(spread: &Spread) -> String {
    let Spread { count, p50_ms, p99_ms, max_ms } = spread;
    format!("p50 {p50_ms:.1} ms, p99 {p99_ms:.1} ms, most {max_ms:.1} ms, of {count}")
}

#[expect(clippy::cast_precision_loss, reason = "it is shown with three digits")]
fn rate(count: u64, seconds: f64) -> f64 {
    count as f64 / seconds.max(0.001)
}

/// The most memory that was resident, with that of a server that was started again.
fn memory(outcome: &Outcome) -> String {
    let (peak, again) = (outcome.memory_peak_mib, outcome.memory_again_mib);
    if again == 0 { format!("{peak} MiB") } else { format!("{peak} MiB, again {again} MiB") }
}
