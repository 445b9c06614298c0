//! Stops a run whose model mostly fails in one way: then a setting is wrong, and further questions are paid for in
//! vain.

use std::sync::{Mutex, MutexGuard};

use super::stop_reason::StopReason;
use crate::llm::completion::one_line;
use swarmbench_protocol::act::{Receipt, SwarmAct};
use swarmbench_protocol::failure::{Failure, Failures};

/// The default share of answers failing in one way above which an evaluation stops.
pub const STOP_SHARE: f64 = 0.5;

/// Minimum number of answers, in this call, before a run is judged: eight rounds of twelve agents.
pub const ANSWERS_MIN: u64 = 96;

/// A judge of the answers of a run.
#[derive(Debug)]
pub struct Judge {
    model: String,
    /// The share of answers failing in one way above which the run stops; never with 1.
    share: f64,
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    answers: u64,
    failures: Failures,
    /// The text of the last failed answer, by kind of failure.
    last: [String; Failure::ALL.len()],
}

impl Judge {
    /// Creates a judge without answers.
    #[must_use]
    pub fn new(model: &str, share: f64) -> Self {
        Self { model: model.to_owned(), share, state: Mutex::default() }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().expect("nothing panics while it holds this")
    }

    /// Counts an answer.
    pub fn note(&self, act: &SwarmAct, receipt: &Receipt) {
        let mut state = self.state();
        state.answers += 1;
        if let Some(failure) = receipt.failure {
            state.failures.count(failure);
            let said = act.response.as_deref().filter(|said| !said.trim().is_empty());
            let said = said.or(act.reasoning.as_deref()).unwrap_or_default();
            state.last[failure as usize] = one_line(said);
        }
    }

    /// # Errors
    /// [`StopReason::Failing`] where most answers fail in one way.
    pub fn check(&self) -> Result<(), StopReason> {
        let state = self.state();
        let Some(&(kind, count)) = state.failures.most_frequent().first() else { return Ok(()) };
        #[expect(clippy::cast_precision_loss, reason = "nobody asks 2⁵³ questions")]
        let share = count as f64 / state.answers as f64;
        if state.answers < ANSWERS_MIN || share <= self.share {
            return Ok(());
        }
        let last = match state.last[kind as usize].as_str() {
            "" => "it had no text".to_owned(),
            said => format!("{said:?}"),
        };
        Err(StopReason::Failing {
            model: self.model.clone(),
            kind,
            count,
            answers: state.answers,
            last,
        })
    }
}

/// Advice on what to change if answers fail in this way.
#[must_use]
pub const fn advice(kind: Failure) -> &'static str {
    match kind {
        Failure::Refusal => "ask another model, or with another --prompt-template",
        Failure::ContentFilter => {
            "turn the filter of the endpoint off or ask another endpoint, or use another --prompt-template"
        }
        Failure::Truncated => {
            "raise --max-tokens or --max-completion-tokens, or let the model reason less, for example with --effort low"
        }
        Failure::ToolCall => {
            "turn tools off, for example with --extra '{\"tool_choice\": \"none\"}'"
        }
        Failure::ReasoningOnly => {
            "turn reasoning down with --effort or off with --extra, or raise --max-tokens, so that the model comes to its answer"
        }
        Failure::Rejected => {
            "make prompts shorter with a smaller --view-size or --memory, or raise the context that the endpoint serves"
        }
        Failure::Empty => {
            "see with one question by hand whether the endpoint answers this model in the right chat format"
        }
        Failure::NoMarker | Failure::UnknownAction => {
            "look at what it answers on the page of a game, and use another --prompt-template or a more capable model"
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn judged(share: f64, answers: &[Option<Failure>]) -> Result<(), StopReason> {
        let judge = Judge::new("m", share);
        for failure in answers {
            let act = SwarmAct { response: Some("I\nwill not".to_owned()), ..SwarmAct::default() };
            let receipt = Receipt {
                episode: String::new(),
                agent: String::new(),
                round: 0,
                action: None,
                message: None,
                valid: failure.is_none(),
                failure: *failure,
                duplicate: false,
                waiting_for: 1,
            };
            judge.note(&act, &receipt);
        }
        judge.check()
    }

    #[test]
    fn most_answers_of_one_kind_stop_and_fewer_or_mixed_ones_do_not() {
        let half = [Some(Failure::NoMarker), None].repeat(60);
        assert!(judged(STOP_SHARE, &half).is_ok());
        let mut more = half.clone();
        more.push(Some(Failure::NoMarker));
        assert!(judged(1.0, &[Some(Failure::Empty); 200]).is_ok());
        let stop = judged(STOP_SHARE, &more).expect_err("more than half").to_string();
        for said in
            ["61 were without ACTION:", "121 answers of m", "--prompt-template", "\"I will not\""]
        {
            assert!(stop.contains(said), "{said}: {stop}");
        }
        assert!(judged(STOP_SHARE, &more[..95]).is_ok(), "too few to judge");
        let kinds = [Some(Failure::Empty), Some(Failure::Refusal)].repeat(60);
        assert!(judged(STOP_SHARE, &kinds).is_ok(), "no kind has more than half");
    }
}
