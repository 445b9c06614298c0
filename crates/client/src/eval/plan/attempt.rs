//! The plan of an attempt: the competition defines the games, the entrant has declared the player.

use super::{Plan, PlanError, Prices, Who};
use crate::eval::entry::Entry;
use crate::eval::experiment::{Experiment, List};
use swarmbench_prompt::chosen;

impl Experiment {
    /// The fields with which the experiment defines games, which in an attempt the competition does. Settings begin
    /// with `settings.`.
    #[must_use]
    pub fn says_what_is_played(&self) -> Vec<String> {
        let fields = [
            ("tasks", self.tasks.is_some()),
            ("seeds", self.seeds.is_some()),
            ("vary", !self.vary.is_empty()),
            ("teams", !self.teams.is_empty()),
            ("parallel", self.parallel.is_some()),
            ("harness.answer", self.harness.answer.is_some()),
        ];
        let fields = fields.into_iter().filter(|(_, is_said)| *is_said);
        let of_models = ["temperature", "top_p"];
        let settings = self.settings.lists().into_keys();
        let settings = settings.filter(|name| !of_models.contains(&name.as_str()));
        fields
            .map(|(name, _)| name.to_owned())
            .chain(settings.map(|name| format!("settings.{name}")))
            .collect()
    }
}

impl Plan {
    /// Plans an attempt. A temperature and a `top_p` that the experiment leaves out are the declared ones; the prompt
    /// template is always the declared one, as the server makes prompts. `template` is the requested one, its text or
    /// its name.
    ///
    /// # Errors
    /// All problems: those of any plan, several players, and a player other than the declared one.
    pub fn of_attempt(
        experiment: &Experiment,
        template: Option<&str>,
        prices: &Prices<'_>,
        entry: Entry,
    ) -> Result<Self, PlanError> {
        let mut experiment = experiment.clone();
        let suite = entry.suite();
        experiment.tasks = Some(List(suite.tasks.clone()));
        let settings = &mut experiment.settings;
        if settings.temperature.is_empty() {
            settings.temperature.extend(entry.entrant.temperature);
        }
        if settings.top_p.is_empty() {
            settings.top_p.extend(entry.entrant.top_p);
        }
        let text = chosen(template.map(str::to_owned));
        let mut plan = Self::of(&experiment, text.as_deref(), prices)?;
        let count = plan.runs.len();
        let [run] = plan.runs.as_mut_slice() else {
            let problem = format!(
                "an attempt is played by one model or player, asked in one way; this names {count}"
            );
            return Err(PlanError(vec![problem]));
        };
        let (name, entrant) = (entry.competition.name.clone(), entry.entrant.name.clone());
        run.suite = suite;
        run.entry = Some(Box::new(entry));
        let differences = match &run.entry {
            Some(entry) => entry.differences(run, template),
            None => Vec::new(),
        };
        if !differences.is_empty() {
            let what = if matches!(run.who, Who::Model(_)) { "model" } else { "player" };
            return Err(PlanError(vec![format!(
                "the entrant {entrant:?} declared {}. No attempt was started: play with what was declared, or enter again with another \
                 name to play with another {what}",
                differences.join("; "),
            )]));
        }
        plan.name = name;
        Ok(plan)
    }
}
