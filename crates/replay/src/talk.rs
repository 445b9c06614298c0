//! Messages of a round: their agreement, and their readers.

use std::collections::BTreeMap;

use swarmbench_analysis::game::{Decision, Heard};
use swarmbench_protocol::replay::{ReplayHeard, ReplayMark};

/// Agreement of the messages of a round.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Talk {
    #[default]
    Nobody,
    Some,
    /// At least two agents spoke, and all texts are equal.
    Agreed,
}

impl Talk {
    pub(super) fn of(decisions: &[Decision]) -> Self {
        let mut texts = decisions.iter().filter_map(|decision| decision.message.as_deref());
        let Some(first) = texts.next() else { return Self::Nobody };
        let mut others = texts.peekable();
        let is_single = others.peek().is_none();
        if !is_single && others.all(|text| text == first) { Self::Agreed } else { Self::Some }
    }

    /// The mark of a change since the round before.
    pub(super) fn marks(self, before: Self) -> Option<ReplayMark> {
        match self {
            _ if self == before => None,
            Self::Nobody => Some(ReplayMark::Silence),
            Self::Some => None,
            Self::Agreed => Some(ReplayMark::Convergence),
        }
    }
}

/// The messages read with the state after `round`, grouped by sender and text.
pub(super) fn heard(round: u32, decisions: &[Decision], read: &[Heard]) -> Vec<ReplayHeard> {
    let mut readers = BTreeMap::<_, Vec<u16>>::new();
    for heard in read {
        let message = (heard.sender.0, heard.sent, heard.text.as_str());
        readers.entry(message).or_default().push(heard.receiver.0);
    }
    let said = |from: u16| decisions.get(usize::from(from))?.message.as_deref();
    let shown = readers.into_iter().map(|((from, sent, text), by)| ReplayHeard {
        from,
        by,
        sent: (sent != round).then_some(sent),
        text: (said(from) != Some(text)).then(|| text.to_owned()),
    });
    shown.collect()
}
