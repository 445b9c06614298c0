//! Options for attempts in competitions.

use anyhow::{anyhow, ensure};

use swarmbench_client::client::{Client, ClientError};
use swarmbench_client::eval::conduct::Found;
use swarmbench_client::eval::entry::{Entry, EntryError};
use swarmbench_client::eval::experiment::Experiment;
use swarmbench_client::eval::plan::Plan;
use swarmbench_client::eval::report::Played;
use swarmbench_client::eval::stop_reason::StopReason;
use swarmbench_protocol::run::{RunDetail, RunSummary};

#[derive(Debug, clap::Args)]
pub(super) struct Attempt {
    /// The competition in which to play an attempt, with the entrant's key: the attempt that was begun, or else the next open
    /// one.
    #[arg(long = "attempt", value_name = "COMPETITION")]
    pub(super) competition: Option<String>,
    /// The entrant, if the key has several.
    #[arg(long, requires = "competition")]
    entrant: Option<String>,
    /// The number of the attempt.
    #[arg(
        long = "attempt-number",
        value_name = "NUMBER",
        requires = "competition",
        conflicts_with = "again"
    )]
    number: Option<u32>,
}

impl Attempt {
    /// Refuses settings that the competition decides, by their names on the command line or in the file.
    pub(super) fn check(&self, said: &Experiment, file: Option<&Experiment>) -> anyhow::Result<()> {
        let Some(competition) = &self.competition else { return Ok(()) };
        let option = |field: String| {
            let name = field.strip_prefix("settings.").unwrap_or(&field).replace('_', "-");
            format!("--{}", if name == "tasks" { "task" } else { &name })
        };
        let options = said.says_what_is_played().into_iter().map(option);
        let fields = file.map(Experiment::says_what_is_played).unwrap_or_default().into_iter();
        let fields = fields.map(|field| format!("`{field}` of the file"));
        let found: Vec<String> = options.chain(fields).collect();
        ensure!(
            found.is_empty(),
            "the competition {competition} decides which games an attempt plays, so leave out {}",
            found.join(", ")
        );
        Ok(())
    }

    pub(super) async fn entry(&self, client: &Client) -> anyhow::Result<Entry> {
        let competition = self.competition.as_deref().unwrap_or_default();
        let entrant = self.entrant.as_deref();
        let found = Entry::find(client, competition, entrant, self.number).await;
        found.map_err(|error| match error {
            EntryError::Client(ClientError::Refused { problem, .. })
                if problem.code == "unauthorized" =>
            {
                anyhow!(
                    "the server does not take this key ({}): show that of the entrant with --key or SWARMBENCH_KEY",
                    problem.detail
                )
            }
            EntryError::Client(ClientError::Refused { problem, .. })
                if problem.code == "not_found" =>
            {
                let of = entrant.map_or_else(String::new, |entrant| format!(", {entrant}"));
                anyhow!("{}: {competition}{of}", problem.detail)
            }
            error => anyhow!(error),
        })
    }
}

/// A sentence about the start of an attempt, or that it is over.
pub(super) fn begun(entry: &Entry, found: &Found, run: &RunDetail) -> String {
    let RunDetail {
        run: RunSummary { id, attempt, status, played, planned, parallel, closes_at, .. },
        ..
    } = run;
    let number = attempt.map_or_else(String::new, |number| format!(" {number}"));
    let attempt =
        format!("attempt{number} of {} in {}: {id}", entry.entrant.name, entry.competition.name);
    let until = closes_at.map_or_else(String::new, |at| format!("; no round begins after {at}"));
    match found {
        Found::Finished => {
            format!("{attempt} is {status}; --again starts the next attempt that is open")
        }
        Found::Resumed | Found::Repeats(_) => {
            format!(
                "{attempt} resumes: {played} of {planned} games were played, {parallel} at once{until}"
            )
        }
        Found::New(_) => format!("{attempt} is new: {planned} games, {parallel} at once{until}"),
    }
}

/// Warns of settings of an attempt that cannot be compared with the entrant's declaration.
pub(super) fn warn(plan: &Plan) {
    for run in &plan.runs {
        let unknown = run.entry.as_ref().map_or_else(Vec::new, |entry| entry.unknown(run));
        if !unknown.is_empty() {
            note!(
                "the server does not show what was declared about {}: see yourself that it is the same",
                unknown.join(", ")
            );
        }
    }
}

/// Tells how to continue an attempt that was stopped, whose clocks keep running.
pub(super) fn tell_clocks(plan: &Plan, played: &[Played], failures: &[(usize, StopReason)]) {
    if plan.runs.iter().all(|run| run.entry.is_none()) {
        return;
    }
    // The server may have started an attempt and failed to report it.
    let is_unknown = failures.iter().any(|(_, reason)| matches!(reason, StopReason::Client(_)));
    match played.first() {
        None if is_unknown => {}
        None => note!("no attempt was started"),
        Some(Played { run, .. }) => {
            let closes_at = run
                .run
                .closes_at
                .map_or_else(String::new, |at| format!(" No round begins after {at}."));
            note!(
                "the clocks of the attempt's games run on: rounds in which nobody acts time out.{closes_at}"
            );
        }
    }
}
