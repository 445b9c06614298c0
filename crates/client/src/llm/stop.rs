//! Why requests to an endpoint stop, and what to do about it.

use std::path::PathBuf;

/// The end of a run that is no fault of the model: it costs the model no move, and the run can resume where it
/// stopped. `Display` is for people: what happened, and what to do next. No key is ever in it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Stop {
    /// 401: the endpoint wants another key, or any.
    #[error(
        "{url} asks for a good key (401), and {state}; put a key of this endpoint into {variable}, or name the variable \
         that holds one with --api-key-env. {said}"
    )]
    WrongKey {
        /// What was asked.
        url: String,
        /// The environment variable of the key.
        variable: String,
        /// What is known of the key: refused, empty, not set.
        state: String,
        /// What the endpoint said.
        said: Said,
    },
    /// 403: the key is known, and may not do this.
    #[error(
        "{url} forbids this (403), and {state}; see whether the key in {variable} may use the model {model}, and whether \
         the endpoint serves this place. {said}"
    )]
    Forbidden {
        /// What was asked.
        url: String,
        /// The environment variable of the key.
        variable: String,
        /// What is known of the key.
        state: String,
        /// Which model.
        model: String,
        /// What the endpoint said.
        said: Said,
    },
    /// 402, or a 429 that no waiting helps against: nothing is left on the account.
    #[error(
        "the account at {url} has no credit left ({status}); add credit or raise its limit there, then run the \
         same command again to continue. {said}"
    )]
    NoCredit {
        /// What was asked.
        url: String,
        /// The status.
        status: u16,
        /// What the endpoint said.
        said: Said,
    },
    /// 404 or 405: no such model, or nothing that answers chats is at this address.
    #[error("{url} was not found ({status}) for the model {model}; {hint}. {said}")]
    NotFound {
        /// What was asked.
        url: String,
        /// The status.
        status: u16,
        /// Which model.
        model: String,
        /// What to try.
        hint: String,
        /// What the endpoint said.
        said: Said,
    },
    /// Another 4xx: the endpoint does not take the request as it is.
    #[error("{url} refuses the request ({status}){hint}. {said}")]
    BadRequest {
        /// What was asked.
        url: String,
        /// The status.
        status: u16,
        /// What to change, where that is known.
        hint: String,
        /// What the endpoint said.
        said: Said,
    },
    /// The endpoint answers with a stream of events, though none was asked for, or refuses to answer without one.
    #[error(
        "{url} answers with a stream of events only, and only whole answers are read; turn streaming off at the \
         endpoint (many proxies have a setting for it), or name another endpoint with --api-base{}",
        if said.0.is_empty() { String::new() } else { format!(". {said}") }
    )]
    OnlyStreams {
        /// What was asked.
        url: String,
        /// What the endpoint said, if it refused.
        said: Said,
    },
    /// 3xx: the endpoint is elsewhere, and a key is not carried there unasked.
    #[error(
        "{url} sends on to {to} ({status}), and keys are not carried to other addresses; if you trust that address, \
         name it with --api-base"
    )]
    Elsewhere {
        /// What was asked.
        url: String,
        /// The status.
        status: u16,
        /// Where it sends.
        to: String,
    },
    /// It was interrupted before this question was asked.
    #[error("interrupted; run the same command again to resume")]
    Interrupted,
    /// The tokens that may be spent are spent.
    #[error(
        "the token budget is spent: {spent} of {budget} tokens; run the same command with a larger budget to resume"
    )]
    BudgetSpent {
        /// Tokens that were spent.
        spent: u64,
        /// Tokens that were to be spent at most.
        budget: u64,
    },
    /// The endpoint could not be had, however often it was tried.
    #[error(
        "{url} gave no answer in {tries} tries in a row; the last: {last}. No move was lost: run the same command again \
         when it answers"
    )]
    Unreachable {
        /// What was asked.
        url: String,
        /// How many tries failed in a row.
        tries: u32,
        /// What happened the last time.
        last: String,
    },
    /// The endpoint wants to be left alone for longer than anybody wants to wait.
    #[error(
        "{url} asks to retry in {wait_s} s ({last}), longer than the {patience_s} s that one pause may take; run the \
         same command again then, or allow longer pauses with --patience"
    )]
    ComeLater {
        /// What was asked.
        url: String,
        /// Seconds that it asked for.
        wait_s: u64,
        /// Seconds that a pause may take.
        patience_s: u64,
        /// What it answered.
        last: String,
    },
    /// What is to be played again is not on the cassette.
    #[error("{}: no answer for {agent} in round {round} of {game}: {why}", path.display())]
    NotOnCassette {
        /// The file.
        path: PathBuf,
        /// Of which game.
        game: String,
        /// Of whom.
        agent: String,
        /// In which round.
        round: u32,
        /// What is there instead, and what that means.
        why: String,
    },
    /// The cassette cannot be read or written.
    #[error("the cassette {}: {what}", path.display())]
    Cassette {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// A setting that cannot work.
    #[error("{0}")]
    Settings(String),
}

/// What an endpoint said in a refusal: one line, cut, and without the key.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Said(pub(super) String);

impl std::fmt::Display for Said {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self.0.as_str() {
            "" => f.write_str("It gave no reason"),
            text => write!(f, "It said: {text}"),
        }
    }
}
