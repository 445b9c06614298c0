//! An entrant in a competition: what its attempts play, what it declared of who plays, and which attempt is next.

use swarmbench_engine::{Settings, TaskName};
use swarmbench_protocol::competition::{
    AttemptRequest, AttemptSummary, Competition, EntrantDetail, EntrantList, EntrantSummary,
    SealedSuite, StartedAttempt,
};
use swarmbench_protocol::run::{RunDetail, RunSummary};
use swarmbench_protocol::suite::{Suite, SuiteSettings, digest_of_template};

use super::plan::{Planned, Who};
use super::stop_reason::StopReason;
use crate::client::{Client, ClientError};
use swarmbench_prompt::{Identity, chosen};

/// Separator of the digest of a system message from the name of a prompt.
const SYSTEM_PREFIX: &str = "+system:";

/// Entry of a player in a competition.
#[derive(Clone, Debug, PartialEq)]
pub struct Entry {
    /// The competition.
    pub competition: Competition,
    /// The entrant, with what it declared.
    pub entrant: EntrantSummary,
    /// The attempt that is asked for; by default one that was begun, or else the next.
    pub number: Option<u32>,
}

/// Error of an entry: the entrant that is to play is not known.
#[derive(Debug, thiserror::Error)]
pub enum EntryError {
    /// The server cannot be asked.
    #[error(transparent)]
    Client(#[from] ClientError),
    /// The key has no entrant.
    #[error(
        "this key has no entrant in {0}: enter with `swarmbench competition enter`, or show the key that you got there"
    )]
    None(String),
    /// The named one belongs to another key.
    #[error(
        "{0} is not an entrant of this key: show the key that you got when you entered, or leave --entrant out"
    )]
    Foreign(String),
    /// The key has several.
    #[error("this key has {} entrants: name one with --entrant: {}", .0.len(), .0.join(", "))]
    Several(Vec<String>),
}

/// Next step with an entrant's attempts.
#[derive(Debug, PartialEq)]
pub(super) enum Next<'a> {
    /// Resumes the attempt that was begun.
    Resume(&'a AttemptSummary),
    /// Ends: the attempt is played, and no other was requested.
    Over(&'a AttemptSummary),
    /// Starts the attempt with this number, or the next one.
    Start(Option<u32>),
}

impl Entry {
    /// The entrant of the client's key in a competition: the one that is named, or the only one.
    ///
    /// # Errors
    /// The server, or that it is not clear which entrant is meant.
    pub async fn find(
        client: &Client,
        competition: &str,
        entrant: Option<&str>,
        number: Option<u32>,
    ) -> Result<Self, EntryError> {
        let competition: Competition = client.get(&path(competition, "")).await?;
        let entrant = match entrant {
            None => only_entrant(client, &competition).await?,
            Some(id) => {
                let found = own(client, &competition.id, id).await?;
                found.ok_or_else(|| EntryError::Foreign(id.to_owned()))?.entrant
            }
        };
        Ok(Self { competition, entrant, number })
    }

    /// The attempts, in the order in which they were started.
    pub(super) async fn attempts(
        &self,
        client: &Client,
    ) -> Result<Vec<AttemptSummary>, ClientError> {
        let entrant = format!("/entrants/{}", self.entrant.id);
        let shown: EntrantDetail = client.get(&path(&self.competition.id, &entrant)).await?;
        Ok(shown.attempts)
    }

    /// Next step. Attempts that were voided are as if they had never been started.
    pub(super) fn next<'a>(&self, attempts: &'a [AttemptSummary], again: bool) -> Next<'a> {
        let is_asked = |attempt: &&AttemptSummary| {
            attempt.voided.is_none() && self.number.is_none_or(|number| number == attempt.attempt)
        };
        let mut asked = attempts.iter().filter(is_asked);
        match asked.clone().find(|attempt| attempt.status == "running") {
            Some(begun) => Next::Resume(begun),
            None => match asked.next_back().filter(|_| !again || self.number.is_some()) {
                Some(over) => Next::Over(over),
                None => Next::Start(self.number),
            },
        }
    }

    /// Starts an attempt. The server's refusal is a sentence of its own.
    pub(super) async fn start(
        &self,
        client: &Client,
        attempt: Option<u32>,
    ) -> Result<StartedAttempt, StopReason> {
        let request = AttemptRequest { entrant: Some(self.entrant.id.clone()), attempt };
        match client.create(&path(&self.competition.id, "/attempts"), &request).await {
            Ok(started) => Ok(started),
            Err(ClientError::Refused { problem, .. })
                if ["closed", "forbidden"].contains(&problem.code.as_str()) =>
            {
                Err(StopReason::NotStarted(problem.detail))
            }
            Err(error) => Err(error.into()),
        }
    }

    /// Suite that is played; the seeds are sealed.
    pub(super) fn suite(&self) -> Suite {
        let SealedSuite { tasks, rules, settings, .. } = &self.competition.suite;
        let all = || TaskName::ALL.map(|task| task.name().to_owned()).to_vec();
        let usual = Settings::default();
        let rules = rules.clone().unwrap_or_else(|| usual.rules.clone());
        let settings = settings.clone().unwrap_or_default().over(usual);
        Suite {
            name: self.competition.name.clone(),
            tasks: tasks.clone().unwrap_or_else(all),
            seeds: Vec::new(),
            seeds_by_task: false,
            rules,
            settings: SuiteSettings::from(&settings),
        }
    }

    /// Number of sealed seeds on which each task is played.
    #[must_use]
    pub fn seeds(&self) -> usize {
        let seeds = self.competition.suite.seeds.and_then(|seeds| usize::try_from(seeds).ok());
        seeds.unwrap_or_default()
    }

    /// The prompt that a model gets, with this digest of a system message.
    pub(super) fn prompt(&self, system: Option<String>) -> Identity {
        Identity { system, ..Identity::declared(self.entrant.prompt_template.clone(), None) }
    }

    /// In which ways a run would be played by another player than the entrant declared, in words; `template` is the one
    /// that was asked for, its text or its name.
    pub(super) fn differences(&self, planned: &Planned, template: Option<&str>) -> Vec<String> {
        let EntrantSummary { model, temperature, top_p, prompt_template, prompt, .. } =
            &self.entrant;
        let mut found = Vec::new();
        let mut compare = |what: &str, declared: Option<String>, is: Option<String>| {
            let text = |value: &Option<String>| value.clone().unwrap_or_else(|| "none".to_owned());
            if declared != is {
                found.push(format!("{what} {}, not {}", text(&declared), text(&is)));
            }
        };
        let name = planned.name();
        let is_same = name == *model
            || name.strip_prefix(swarmbench_protocol::names::BUILT_IN) == Some(model);
        let name = if is_same { model.clone() } else { name };
        compare("model", Some(format!("{model:?}")), Some(format!("{name:?}")));
        let [own_temperature, own_top_p] = planned.sampling();
        let number = |value: Option<f64>| value.map(|value| value.to_string());
        compare("temperature", number(*temperature), number(own_temperature));
        compare("top_p", number(*top_p), number(own_top_p));
        if let Some(template) = template {
            let digest = chosen(Some(template.to_owned())).as_deref().map(digest_of_template);
            compare("the prompt template with the digest", prompt_template.clone(), digest);
        }
        if self.tells_system() {
            let declared = system_of(prompt);
            let is = system_of(&planned.prompt().to_string());
            compare("a system message with the digest", declared, is);
        }
        found
    }

    /// True if the server says if a system message was declared. Servers of earlier versions do not.
    fn tells_system(&self) -> bool {
        !self.entrant.prompt.is_empty()
    }

    /// Options of a run that cannot be compared with what was declared, as the server does not show them.
    #[must_use]
    pub fn unknown(&self, planned: &Planned) -> Vec<&'static str> {
        let Who::Model(model) = &planned.who else { return Vec::new() };
        let options = [
            ("--system", model.system.is_some() && !self.tells_system()),
            ("--max-tokens", model.sampling.max_tokens.is_some()),
            ("--max-completion-tokens", model.sampling.max_completion_tokens.is_some()),
            ("--effort", model.sampling.effort.is_some()),
            ("--thinking-budget", model.sampling.thinking_budget.is_some()),
            ("--reasoning-summary", model.sampling.reasoning_summary.is_some()),
            ("--extra", !model.extra.is_empty()),
            ("the harness", model.harness.meta("").is_some()),
        ];
        options.into_iter().filter(|(_, is_said)| *is_said).map(|(name, _)| name).collect()
    }

    /// Adds the results of an attempt, which its run shows to nobody while the seeds are sealed.
    pub(super) async fn add_results(
        &self,
        client: &Client,
        run: &mut RunDetail,
    ) -> Result<(), ClientError> {
        let attempts = self.attempts(client).await?;
        let Some(attempt) = attempts.iter().find(|attempt| attempt.run == run.run.id) else {
            return Ok(());
        };
        let RunSummary { tasks, total, .. } = &mut run.run;
        for result in attempt.tasks.iter().flatten() {
            for task in tasks.iter_mut().filter(|task| task.task == result.task) {
                (task.mean, task.deviation) = (result.mean, result.deviation);
            }
        }
        *total = attempt.total;
        Ok(())
    }

    /// Why an attempt is over although not all of it was played.
    pub(super) fn ended(&self, run: &RunSummary) -> StopReason {
        let attempt = run.attempt.map_or_else(|| run.id.clone(), |number| number.to_string());
        let counts = "It counts with what it has.";
        StopReason::AttemptOver(match (&run.void_reason, run.status.as_str()) {
            (Some(reason), _) => format!(
                "attempt {attempt} was voided by an organizer: {reason}. It does not count; the same command starts it again."
            ),
            (None, "closed") => {
                let closes_at = run.closes_at.unwrap_or(self.competition.closes_at);
                format!(
                    "attempt {attempt} closed at {closes_at}, before all of it was played. {counts}"
                )
            }
            (None, "abandoned") => format!(
                "attempt {attempt} was abandoned: nobody acted in one of its games for {} s. {counts}",
                run.idle_timeout_s.0
            ),
            (None, status) => {
                format!("attempt {attempt} was {status} before all of it was played. {counts}")
            }
        })
    }
}

/// The digest of the system message in the name of a prompt. The harness may follow it.
fn system_of(prompt: &str) -> Option<String> {
    let (_, digest) = prompt.split_once(SYSTEM_PREFIX)?;
    digest.split('+').next().map(str::to_owned)
}

/// The address of something of a competition.
fn path(competition: &str, rest: &str) -> String {
    format!("/api/v1/competitions/{competition}{rest}")
}

/// An entrant, if it belongs to the client's key.
async fn own(
    client: &Client,
    competition: &str,
    entrant: &str,
) -> Result<Option<EntrantDetail>, ClientError> {
    match client.get(&path(competition, &format!("/entrants/{entrant}"))).await {
        Ok(entrant) => Ok(Some(entrant)),
        Err(ClientError::Refused { problem, .. }) if problem.code == "forbidden" => Ok(None),
        Err(error) => Err(error),
    }
}

/// The only entrant of the client's key.
async fn only_entrant(
    client: &Client,
    competition: &Competition,
) -> Result<EntrantSummary, EntryError> {
    // A key has at most 100 entrants, which fit on a page.
    let path = path(&competition.id, "/entrants");
    let own: EntrantList = client.get_with(&path, &[("own", "true")]).await?;
    let mut own = own.items;
    if own.len() > 1 {
        let shown = |own: &EntrantSummary| format!("{} ({:?}, {})", own.id, own.name, own.model);
        return Err(EntryError::Several(own.iter().map(shown).collect()));
    }
    own.pop().ok_or_else(|| EntryError::None(competition.id.clone()))
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;

    fn entry(number: Option<u32>) -> Entry {
        let at = "2027-03-01T12:00:00.000Z";
        let competition = json!({
            "id": "cmp_1", "name": "a cup", "description": "", "phase": "open", "opens_at": at, "closes_at": at,
            "suite": { "tasks": ["Foraging"], "seeds": 2 }, "clocks": {}, "entry": "anybody", "attempts": [],
            "parallel": 1, "counts": "best", "board": "hidden", "entries_per_key": 1, "commitment": "", "created_at": at,
        });
        let entrant = json!({
            "id": "ent_1", "name": "blue", "model": "m", "prompt": "default", "status": "active", "vouched": false,
            "registered_at": at,
        });
        Entry {
            competition: serde_json::from_value(competition).expect("a competition"),
            entrant: serde_json::from_value(entrant).expect("an entrant"),
            number,
        }
    }

    fn attempts(all: &[(u32, &str, Option<&str>)]) -> Vec<AttemptSummary> {
        let attempt = |(number, status, voided): &(u32, &str, Option<&str>)| -> Value {
            json!({
                "entrant": "ent_1", "attempt": number, "run": format!("run_{number}"), "status": status,
                "created_at": "2027-03-01T12:00:00.000Z", "games": 2, "games_ended": 0, "voided": voided,
            })
        };
        let all: Vec<Value> = all.iter().map(attempt).collect();
        serde_json::from_value(json!(all)).expect("attempts")
    }

    #[test]
    fn what_was_begun_is_resumed_and_nothing_else_is_started_unasked() {
        let finished = (1, "finished", None);
        let voided = (1, "aborted", Some("a power cut"));
        let running = (2, "running", None);
        let told = |number: Option<u32>, again: bool, all: &[(u32, &str, Option<&str>)]| {
            let all = attempts(all);
            match entry(number).next(&all, again) {
                Next::Resume(attempt) => format!("resume {}", attempt.attempt),
                Next::Over(attempt) => format!("over {}", attempt.attempt),
                Next::Start(number) => format!("start {number:?}"),
            }
        };
        assert_eq!(told(None, false, &[]), "start None");
        assert_eq!(told(None, false, &[voided]), "start None");
        assert_eq!(told(None, false, &[finished]), "over 1");
        assert_eq!(told(None, true, &[finished]), "start None");
        assert_eq!(
            told(None, true, &[finished, running]),
            "resume 2",
            "that is the one that was asked for"
        );
        assert_eq!(told(None, false, &[running, finished]), "resume 2");
        assert_eq!(told(Some(1), false, &[finished, running]), "over 1");
        assert_eq!(told(Some(1), false, &[voided, running]), "start Some(1)");
        assert_eq!(told(Some(2), false, &[finished, running]), "resume 2");
        assert_eq!(told(Some(3), false, &[finished, running]), "start Some(3)");
    }
}
