//! Reasons why requests to an endpoint stop, with advice.

use std::path::PathBuf;

use super::price::to_usd;

/// End of a run that is no fault of the model: it costs the model no move, and the run can resume. `Display` tells people what
/// happened and what to do next, without any key.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Stop {
    /// 401: the endpoint requires another key, or any.
    #[error(
        "{url} asks for a good key (401), and {state}; put a key of this endpoint into {variable}, or name the variable \
         that holds one with --api-key-env. {said}"
    )]
    WrongKey {
        /// Requested address.
        url: String,
        /// Environment variable of the key.
        variable: String,
        /// State of the key: refused, empty, not set.
        state: String,
        /// Message of the endpoint.
        said: Said,
    },
    /// 403: the key is valid but lacks a permission.
    #[error(
        "{url} forbids this (403), and {state}; see whether the key in {variable} may use the model {model}, and whether \
         the endpoint serves this place. {said}"
    )]
    Forbidden {
        /// Requested address.
        url: String,
        /// Environment variable of the key.
        variable: String,
        /// State of the key.
        state: String,
        /// Name of the model.
        model: String,
        /// Message of the endpoint.
        said: Said,
    },
    /// 402, or a permanent 429: the account has no credit left.
    #[error(
        "the account at {url} has no credit left ({status}); add credit or raise its limit there, then run the \
         same command again to continue. {said}"
    )]
    NoCredit {
        /// Requested address.
        url: String,
        /// Status of the answer.
        status: u16,
        /// Message of the endpoint.
        said: Said,
    },
    /// 404 or 405: the model does not exist, or nothing at this address answers chats.
    #[error("{url} was not found ({status}) for the model {model}; {hint}. {said}")]
    NotFound {
        /// Requested address.
        url: String,
        /// Status of the answer.
        status: u16,
        /// Name of the model.
        model: String,
        /// Advice.
        hint: String,
        /// Message of the endpoint.
        said: Said,
    },
    /// Another 4xx: the endpoint does not accept the request.
    #[error("{url} refuses the request ({status}){hint}. {said}")]
    BadRequest {
        /// Requested address.
        url: String,
        /// Status of the answer.
        status: u16,
        /// Advice, if the fault is known.
        hint: String,
        /// Message of the endpoint.
        said: Said,
    },
    /// 3xx: the endpoint is elsewhere. The key is not sent there without consent.
    #[error(
        "{url} sends on to {to} ({status}), and keys are not carried to other addresses; if you trust that address, \
         name it with --api-base"
    )]
    Elsewhere {
        /// Requested address.
        url: String,
        /// Status of the answer.
        status: u16,
        /// Target of the redirection.
        to: String,
    },
    /// An interruption before this question was asked.
    #[error("interrupted; run the same command again to resume")]
    Interrupted,
    /// The token budget is spent.
    #[error(
        "the token budget is spent: {spent} of {budget} tokens; run the same command with a larger budget to resume"
    )]
    BudgetSpent {
        /// Tokens that were spent.
        spent: u64,
        /// Tokens of the budget.
        budget: u64,
    },
    /// The budget of money has too little left for another request. Amounts are billionths of a US dollar.
    #[error(
        "the budget is spent: {:.4} of {:.4} US dollars, and the next request may cost {:.4}{}",
        to_usd(*spent),
        to_usd(*budget),
        to_usd(*next),
        "; a limit of tokens for each answer (--max-tokens) lowers that; the next call has a new budget of this size"
    )]
    MoneySpent {
        /// Cost of what was asked.
        spent: u64,
        /// The budget.
        budget: u64,
        /// Highest cost of the request that was not begun.
        next: u64,
    },
    /// All tries failed.
    #[error(
        "{url} gave no answer in {tries} tries in a row; the last: {last}. {}No move was lost: run the same command again \
         when it answers",
        if *is_unknown {
            "This address has not given any answer yet, so see whether it is the right one, and whether --timeout allows \
             an answer its time. "
        } else {
            ""
        }
    )]
    Unreachable {
        /// Requested address.
        url: String,
        /// Failed tries in a row.
        tries: u32,
        /// Error of the last try.
        last: String,
        /// True if the address never gave an answer.
        is_unknown: bool,
    },
    /// The endpoint asks for a longer pause than the patience.
    #[error(
        "{url} asks to retry in {wait_s} s ({last}), longer than the {patience_s} s that one pause may take; run the \
         same command again then, or allow longer pauses with --patience"
    )]
    ComeLater {
        /// Requested address.
        url: String,
        /// Seconds that the endpoint asked for.
        wait_s: u64,
        /// Longest pause in seconds.
        patience_s: u64,
        /// Message of the endpoint.
        last: String,
    },
    /// The cassette lacks an answer to replay.
    #[error("{}: no answer for {agent} in round {round} of {game}: {why}", path.display())]
    NotOnCassette {
        /// Path of the cassette.
        path: PathBuf,
        /// Name of the game.
        game: String,
        /// Id of the agent.
        agent: String,
        /// Number of the round.
        round: u32,
        /// Content of the cassette in its place, and the likely cause.
        why: String,
    },
    /// The cassette cannot be read or written.
    #[error("the cassette {}: {what}", path.display())]
    Cassette {
        /// Path of the cassette.
        path: PathBuf,
        /// Problem.
        what: String,
    },
    /// A setting cannot work.
    #[error("{0}")]
    Settings(String),
}

/// Message of an endpoint in a refusal: one line, cut, and without the key.
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
