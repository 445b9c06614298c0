//! Games and requests: all of it follows from one seed, so a client that lost an answer sends
//! the very same act again, and a failure can be played again as far as a real process allows.

use std::time::Duration;

use swarmbench_engine::{Action, AgentId, Control, RuleSet, TaskName};
use swarmbench_protocol::act::{ActRequest, Usage};
use swarmbench_protocol::episode::EpisodeRequest;

use swarmbench_testkit::dice::Dice;

/// Calls by which an episode is played.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum By {
    /// A client for each seat: `/obs` and `/act`.
    Seats,
    /// One client for all: `/swarm/obs` and `/swarm/act`.
    Swarm,
}

/// Every so many games there is one of these.
const FOUND_EVERY: u64 = 8;

/// Games in which random seeds have found a fault, by seed and number: each campaign begins with them, and plays them again.
const FOUND: [(u64, u64); 1] = [
    // Its layout is solved already: it ends with its creation, whatever happens to the server then.
    (1_116_932_293, 4),
];

/// An episode to be played.
#[derive(Clone, Debug)]
pub(crate) struct CampaignGame {
    /// From which seed, and as which game, it is drawn.
    drawn: (u64, u64),
    /// Number of the game in the campaign.
    pub(crate) number: u64,
    pub(crate) by: By,
    pub(crate) request: EpisodeRequest,
    task: TaskName,
    control: Control,
}

impl CampaignGame {
    /// The game with this number: of the seed, or one in which a fault was found.
    pub(crate) fn new(seed: u64, number: u64) -> Self {
        let found = usize::try_from(number % FOUND_EVERY).ok().and_then(|place| FOUND.get(place));
        let (seed, drawn) = found.copied().unwrap_or((seed, number));
        Self { number, ..Self::draw(seed, drawn) }
    }

    /// All tasks, both rule sets, both ways to play, with and without clocks.
    fn draw(seed: u64, number: u64) -> Self {
        let dice = Dice::of(seed, &format!("game {number}"));
        let task = TaskName::ALL[usize::try_from(number).expect("few") % TaskName::ALL.len()];
        let by = if number.is_multiple_of(2) { By::Seats } else { By::Swarm };
        let control = if dice.one_in(4) { Control::Centralized } else { Control::Decentralized };
        let is_clocked = dice.one_in(3);
        // Some are long, so that a restart has many rounds to play again.
        let rounds = if !is_clocked && dice.one_in(5) { 100 } else { 8 + dice.below(24) };
        let text = |text: &str| Some(text.to_owned());
        let request = EpisodeRequest {
            task: text(task.name()),
            seed: Some(dice.below(1000).try_into().expect("small")),
            rules: text(dice.pick(&RuleSet::ALL).name()),
            num_agents: Some(2 + i64::try_from(dice.below(5)).expect("small")),
            max_round: Some(rounds.try_into().expect("small")),
            control: text(control.name()),
            noise: Some(*dice.pick(&[0.0, 0.0, 0.2])),
            max_delay: Some(*dice.pick(&[0, 0, 2])),
            round_deadline_s: is_clocked.then(|| *dice.pick(&[0.05, 0.15, 0.4])),
            bank_s: is_clocked.then(|| *dice.pick(&[0.0, 0.3, 1.0])),
            start: text(if dice.one_in(5) { "manual" } else { "now" }),
            visibility: text(if dice.one_in(3) { "owner" } else { "public" }),
            model: Some(format!("campaign {number}")),
            ..EpisodeRequest::default()
        };
        Self { drawn: (seed, number), number, by, request, task, control }
    }

    pub(crate) fn is_clocked(&self) -> bool {
        self.request.round_deadline_s.is_some()
    }

    pub(crate) fn is_started_by_hand(&self) -> bool {
        self.request.start.as_deref() == Some("manual")
    }

    fn dice(&self, purpose: &str, agent: AgentId, round: u32) -> Dice {
        let (seed, number) = self.drawn;
        Dice::of(seed, &format!("{purpose} {number} {agent} {round}"))
    }

    /// True if a seat lets its clock run out in a round.
    pub(crate) fn is_left_out(&self, agent: AgentId, round: u32) -> bool {
        self.is_clocked() && self.dice("leave out", agent, round).one_in(6)
    }

    /// Time that a seat thinks about a round.
    pub(crate) fn thinks(&self, agent: AgentId, round: u32) -> Duration {
        self.dice("think", agent, round).time(Duration::from_millis(20))
    }

    /// True if a seat waits for the next observation with the same call.
    pub(crate) fn waits_with_the_act(&self, agent: AgentId, round: u32) -> bool {
        self.dice("wait", agent, round).one_in(2)
    }

    /// Act of a seat in a round.
    pub(crate) fn act(&self, agent: AgentId, round: u32) -> ActRequest {
        let dice = self.dice("act", agent, round);
        let action = dice.pick(Action::of_task(self.task)).name().to_owned();
        let mut act = ActRequest { round, ..ActRequest::default() };
        match dice.below(8) {
            0 => act.response = Some("I cannot decide.".to_owned()),
            1 | 2 => {
                act.response = Some(format!(
                    "Round {round}, hm.\n**ACTION:** {action}\n**MSG:** from {agent}"
                ));
            }
            3 => act.action = Some(action),
            _ => {
                act.action = Some(action);
                act.message = Some(format!("  {agent} says\n{} – \"{round}\" ", dice.below(1000)));
                let commands = self.control == Control::Centralized && agent == AgentId::COMMANDER;
                act.to = (commands && dice.one_in(2)).then(|| AgentId(1).to_string());
            }
        }
        if dice.one_in(4) {
            act.usage = Some(Usage {
                prompt_tokens: Some(dice.below(9000) as u64),
                completion_tokens: Some(dice.below(900) as u64),
                ..Usage::default()
            });
        }
        if dice.one_in(6) {
            // Long enough that a commit takes several pages.
            act.reasoning = Some("because ".repeat(1 + dice.below(1500)));
        }
        act
    }
}
