//! The names of all metrics, and what is known of each.

use swarmbench_engine::named;

named! {
    /// Which definition of a metric: the two are never mixed.
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord)]
    pub enum Definition {
        /// The words of the paper, with their gaps closed.
        #[default]
        Paper = "paper",
        /// What the scripts of the public toolkit compute, to compare with published figures.
        Toolkit = "toolkit",
    }
}

named! {
    /// A metric of a game. Its name is that of its column in tables, and its key in JSON.
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
        /// Exploration rate: how many cells agents stood on.
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
        /// The same from 0 to 1.
        DirectionImbalanceNorm = "direction_imbalance_norm",
        /// The same of the counts of all agents together.
        DirectionImbalancePooled = "direction_imbalance_pooled",
        /// Connected components of the graph of who sees whom.
        Components = "components",
        /// The same from 0 (one component) to 1 (every agent alone).
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
        /// Transport: how far the agents in contact with the block push one way.
        PushAlignment = "push_alignment",
        /// Transport: the most agents that pushed the block one way in a round.
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

/// In which panel of the paper's figures a metric is drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Panel {
    /// Messages (b).
    Messages,
    /// Choices (c).
    Choices,
    /// Positions (d).
    Positions,
}

/// Whether a metric is about what agents said or what they did.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Block {
    /// What they said.
    Communication,
    /// What they did.
    Physical,
}

/// What is known of a metric, whatever the game.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct About {
    /// Its name as the paper or this project writes it, for headings.
    pub title: &'static str,
    /// The panel that shows it in the paper's figures; `None` for a metric that they do not draw.
    pub panel: Option<Panel>,
    /// By what it is divided where it is drawn.
    pub divisor: f64,
    /// One of the two blocks that the paper compares; `None` for a metric that is in neither.
    pub block: Option<Block>,
    /// Whether it is one of the paper's thirteen.
    pub of_paper: bool,
    /// Whether it has a value in each round; others have one for the whole game only.
    pub by_round: bool,
    /// Whether it depends on text vectors, so on the embedder.
    pub of_vectors: bool,
}

/// What there is of a whole game.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct RunValue {
    /// The mean over the rounds in which it is defined, or what the metric says; `None` where it is undefined.
    pub value: Option<f64>,
    /// From how many rounds it was computed.
    pub rounds: u32,
}

impl Metric {
    /// What is known of it.
    #[must_use]
    pub fn about(self) -> About {
        todo!("filled in by the metrics part")
    }
}
