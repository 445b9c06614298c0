//! The names and properties of all metrics.

use swarmbench_engine::{TaskName, named};

named! {
    /// A source of definitions. Values by different definitions are never mixed.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
    pub enum Definition {
        /// The paper's definitions, with their gaps closed.
        #[default]
        Paper = "paper",
        /// The computations of the public toolkit's scripts, for comparison with published figures.
        Toolkit = "toolkit",
    }
}

named! {
    /// A metric of a game. Its name is its column in tables and its key in JSON.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
    pub enum Metric {
        /// Proportion of question sentences.
        QuestionShare = "question_share",
        /// Proportion of digit characters.
        DigitShare = "digit_share",
        /// Mean message length, in characters.
        MessageLength = "message_length",
        /// Standard deviation of the message length, in characters.
        MessageLengthStd = "message_length_std",
        /// Information homogeneity: mean cosine of distinct messages.
        Homogeneity = "homogeneity",
        /// Directional entropy, in bits.
        DirectionEntropy = "direction_entropy",
        /// Proportion of agents that chose not to move.
        Stillness = "stillness",
        /// Proportion of the most frequent action.
        DominantAction = "dominant_action",
        /// Polarization index.
        Polarization = "polarization",
        /// Average moving distance of a round, in cells.
        StepLength = "step_length",
        /// Exploration rate: number of cells on which agents stood.
        Explored = "explored",
        /// Local structure preservation count.
        KeptPairs = "kept_pairs",
        /// Agent push events.
        Pushes = "pushes",

        /// Mean distance that agents walked since the layout, in cells.
        PathLength = "path_length",
        /// Push events in which the pushed agent did not choose to move that way.
        PushesStrict = "pushes_strict",
        /// Explored cells as a share of the open ones.
        ExploredShare = "explored_share",
        /// Explored cells at the end.
        ExploredFinal = "explored_final",
        /// Share of agents without an action.
        NoActionShare = "no_action_share",
        /// Mean cosine of all messages, repeats included.
        HomogeneityAll = "homogeneity_all",
        /// Mean edit similarity of distinct messages.
        EditConsistency = "edit_consistency",
        /// Edit similarity of an agent's message to its own previous one.
        SelfRepeat = "self_repeat",

        /// Gini coefficient of an agent's four move actions, mean over agents.
        DirectionImbalance = "direction_imbalance",
        /// `direction_imbalance`, scaled to 0 to 1.
        DirectionImbalanceNorm = "direction_imbalance_norm",
        /// `direction_imbalance` of the summed counts of all agents.
        DirectionImbalancePooled = "direction_imbalance_pooled",
        /// Connected components of the graph of agents that see each other.
        Components = "components",
        /// `components`, scaled from 0 (one component) to 1 (every agent alone).
        ComponentsNorm = "components_norm",
        /// Separation force between neighbours.
        Separation = "separation",
        /// Sum of inverse distances to neighbours.
        Crowding = "crowding",
        /// Share of steps onto a cell that the agent left longer ago than it remembers.
        RevisitShare = "revisit_share",

        /// Increase of the homogeneity over the game: last fifth minus first fifth.
        HomogeneityIncrease = "homogeneity_increase",
        /// Least-squares change of the homogeneity over the game.
        HomogeneitySlope = "homogeneity_slope",
        /// Increase of the edit consistency over the game.
        EditConsistencyIncrease = "edit_consistency_increase",
        /// Least-squares change of the edit consistency over the game.
        EditConsistencySlope = "edit_consistency_slope",

        /// Share of move actions that moved nothing.
        BlockedShare = "blocked_share",
        /// Mean number of agents other than the sender that received a message.
        Delivered = "delivered",
        /// Share of messages that no other agent received.
        UnheardShare = "unheard_share",
        /// Share of messages with one direction word whose sender moved that way, at once or in the next round.
        SayDo = "say_do",
        /// Share of messages that repeat one received the round before.
        Echo = "echo",
        /// Transport: agreement of the directions of agents in contact with the block.
        PushAlignment = "push_alignment",
        /// Transport: maximum number of agents that pushed the block one way in a round.
        ForcePeak = "force_peak",
        /// Synchronization: share of the more frequent state of lights.
        LightAgreement = "light_agreement",
        /// Pursuit: free neighbours of the prey.
        PreyFreedom = "prey_freedom",
        /// Rounds until the score rose for the first time.
        TimeToFirstScore = "time_to_first_score",
        /// Tokens for each point of the final score.
        TokensPerPoint = "tokens_per_point",
    }
}

/// A panel of the paper's figures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Panel {
    /// Messages (b).
    Messages,
    /// Choices (c).
    Choices,
    /// Positions (d).
    Positions,
}

/// The properties of a metric, independent of the game.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct About {
    /// The heading, in the words of the paper or of this project.
    pub title: &'static str,
    /// The panel of the paper's figures; `None` if they do not draw the metric.
    pub panel: Option<Panel>,
    /// True if the metric is one of the paper's thirteen.
    pub of_paper: bool,
    /// True if the metric has a value in each round, not only one for the whole game.
    pub by_round: bool,
    /// True if the metric depends on text vectors, and thus on the embedder.
    pub of_vectors: bool,
}

/// The value of a whole game.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RunValue {
    /// The mean over the rounds in which the metric is defined, unless the metric says otherwise; `None` if it is
    /// undefined.
    pub value: Option<f64>,
    /// The number of rounds that it was computed from.
    pub rounds: u32,
}

/// The metrics of all tasks that follow from a round and the states around it. None of them compares texts.
const OF_ROUNDS: [Metric; 12] = [
    Metric::QuestionShare,
    Metric::DigitShare,
    Metric::MessageLength,
    Metric::DirectionEntropy,
    Metric::Stillness,
    Metric::DominantAction,
    Metric::Polarization,
    Metric::StepLength,
    Metric::KeptPairs,
    Metric::Pushes,
    Metric::Components,
    Metric::BlockedShare,
];

impl Metric {
    /// The metrics of a task that follow from a round and the states around it, without earlier rounds. A
    /// [`Meter`](crate::Meter) that begins in the middle of a game gives the same values for them, and none of them
    /// needs vectors or edits.
    pub fn of_rounds(task: TaskName) -> impl Iterator<Item = Self> {
        let of_task: &[Self] = match task {
            TaskName::Transport => &[Self::PushAlignment, Self::ForcePeak],
            TaskName::Pursuit => &[Self::PreyFreedom],
            TaskName::Synchronization => &[Self::LightAgreement],
            TaskName::Foraging | TaskName::Flocking => &[],
        };
        OF_ROUNDS.iter().chain(of_task).copied()
    }

    /// The properties of the metric.
    #[must_use]
    pub const fn about(self) -> About {
        use Panel::{Choices, Messages, Positions};
        match self {
            Self::QuestionShare => About::in_paper("Proportion of question sentences", Messages),
            Self::DigitShare => About::in_paper("Proportion of digit characters", Messages),
            Self::MessageLength => About::in_paper("Mean message length", Messages),
            Self::MessageLengthStd => {
                About { of_paper: true, ..About::by_round("Standard deviation of message length") }
            }
            Self::Homogeneity => About::in_paper("Information homogeneity", Messages).of_vectors(),
            Self::DirectionEntropy => About::in_paper("Directional entropy", Choices),
            Self::Stillness => About::in_paper("Stillness proportion", Choices),
            Self::DominantAction => About::in_paper("Dominant action proportion", Choices),
            Self::Polarization => About::in_paper("Polarization index", Choices),
            Self::StepLength => About::in_paper("Average moving distance", Positions),
            Self::Explored => About::in_paper("Exploration rate", Positions),
            Self::KeptPairs => About::in_paper("Local structure preservation count", Positions),
            Self::Pushes => About::in_paper("Agent push events", Positions),

            Self::PathLength => About::by_round("Path length"),
            Self::PushesStrict => About::by_round("Agent push events, strict"),
            Self::ExploredShare => About::by_round("Explored share"),
            Self::ExploredFinal => About::of_game("Explored cells at the end"),
            Self::NoActionShare => About::by_round("Share without an action"),
            Self::HomogeneityAll => {
                About::by_round("Information homogeneity, with repeats").of_vectors()
            }
            Self::EditConsistency => About::by_round("Edit consistency"),
            Self::SelfRepeat => About::by_round("Self-repetition"),

            Self::DirectionImbalance => About::of_game("Action direction imbalance"),
            Self::DirectionImbalanceNorm => {
                About::of_game("Action direction imbalance, normalised")
            }
            Self::DirectionImbalancePooled => About::of_game("Action direction imbalance, pooled"),
            Self::Components => About::by_round("Connected components"),
            Self::ComponentsNorm => About::by_round("Connected components, normalised"),
            Self::Separation => About::by_round("Separation force"),
            Self::Crowding => About::by_round("Crowding"),
            Self::RevisitShare => About::of_game("Share of forgotten revisits"),

            Self::HomogeneityIncrease => {
                About::of_game("Increase of information homogeneity").of_vectors()
            }
            Self::HomogeneitySlope => {
                About::of_game("Slope of information homogeneity").of_vectors()
            }
            Self::EditConsistencyIncrease => About::of_game("Increase of edit consistency"),
            Self::EditConsistencySlope => About::of_game("Slope of edit consistency"),

            Self::BlockedShare => About::by_round("Share of blocked moves"),
            Self::Delivered => About::of_game("Receivers of a message"),
            Self::UnheardShare => About::of_game("Share of unheard messages"),
            Self::SayDo => About::of_game("Share of announced moves that were made"),
            Self::Echo => About::by_round("Share of echoed messages"),
            Self::PushAlignment => About::by_round("Push alignment"),
            Self::ForcePeak => About::by_round("Peak force"),
            Self::LightAgreement => About::by_round("Light agreement"),
            Self::PreyFreedom => About::by_round("Free neighbours of the prey"),
            Self::TimeToFirstScore => About::of_game("Rounds to the first score"),
            Self::TokensPerPoint => About::of_game("Tokens per point"),
        }
    }
}

impl About {
    /// A metric that the paper's figures show; there are twelve.
    const fn in_paper(title: &'static str, panel: Panel) -> Self {
        Self { panel: Some(panel), of_paper: true, ..Self::by_round(title) }
    }

    /// A metric of rounds that the figures do not show.
    const fn by_round(title: &'static str) -> Self {
        Self { by_round: true, ..Self::of_game(title) }
    }

    /// A metric of a whole game.
    const fn of_game(title: &'static str) -> Self {
        Self { title, panel: None, of_paper: false, by_round: false, of_vectors: false }
    }

    const fn of_vectors(self) -> Self {
        Self { of_vectors: true, ..self }
    }
}
