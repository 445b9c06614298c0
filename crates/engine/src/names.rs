//! The settings that have names: task, rule set, control and reader of answers. This module uses no other module of the
//! engine.

/// Declares an enum whose values have names on the wire, each given after its value. Generates `ALL` (the values in
/// order), [`name`](TaskName::name), [`parse`](TaskName::parse), [`find`](TaskName::find) and
/// [`canonical`](TaskName::canonical).
#[macro_export]
macro_rules! named {
    ($(#[$about:meta])* $vis:vis enum $kind:ident {
        $($(#[$doc:meta])* $value:ident = $name:literal,)+
    }) => {
        $(#[$about])*
        $vis enum $kind {
            $($(#[$doc])* $value,)+
        }

        impl $kind {
            /// All values in order.
            pub const ALL: [Self; [$($name),+].len()] = [$(Self::$value),+];

            /// The name on the wire.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$value => $name,)+
                }
            }

            /// The value with exactly this name.
            #[must_use]
            pub fn parse(name: &str) -> Option<Self> {
                Self::ALL.into_iter().find(|value| value.name() == name)
            }

            /// The value with this name, ignoring case.
            #[must_use]
            pub fn find(name: &str) -> Option<Self> {
                Self::ALL.into_iter().find(|value| value.name().eq_ignore_ascii_case(name))
            }

            /// Converts a name in any case to the name on the wire; other texts are returned unchanged.
            #[must_use]
            pub fn canonical(name: String) -> String {
                Self::find(&name).map_or(name, |value| value.name().to_owned())
            }
        }
    };
}

named! {
    /// One of the five tasks.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
    pub enum TaskName {
        /// Push a block out of a gap in the wall, then leave through it.
        Transport = "Transport",
        /// Surround a prey that flees.
        Pursuit = "Pursuit",
        /// Switch all lights on, then off, and so on.
        Synchronization = "Synchronization",
        /// Carry food to the nest.
        Foraging = "Foraging",
        /// Form the outline of a square.
        Flocking = "Flocking",
    }
}

named! {
    /// The rule set, one of two (rules: the introduction).
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
    pub enum RuleSet {
        /// The paper's text.
        Paper = "paper",
        /// The public toolkit as it behaves; square maps only.
        Reference = "reference",
    }
}

named! {
    /// The control: the receivers of messages and the size of views.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
    pub enum Control {
        /// Every agent sees a window and sends messages to its neighbours.
        Decentralized = "decentralized",
        /// Every agent sees the whole map and sends messages to the commander alone, and the commander to all.
        Centralized = "centralized",
    }
}

named! {
    /// The reader of a language model's free text (rules: *Answers of language models*).
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
    pub enum AnswerReader {
        /// The last marker of each kind counts, whatever Markdown stands around it.
        #[default]
        LastMarker = "last-marker",
        /// The first marker of each kind counts, wherever it stands: how the public toolkit reads.
        FirstMarker = "first-marker",
        /// The fields of the first JSON object count.
        Json = "json",
    }
}

impl AnswerReader {
    /// The name of the default reader, which is left out of the settings when they are written.
    #[must_use]
    pub fn usual() -> String {
        Self::default().name().to_owned()
    }

    /// True if the name is that of the default reader.
    #[must_use]
    pub fn is_usual(name: &str) -> bool {
        name == Self::default().name()
    }
}
