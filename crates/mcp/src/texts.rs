//! Every sentence that models read, apart from the server's prompt.

use swarmbench_protocol::act::Receipt;
use swarmbench_protocol::problem::Problem;

use crate::seen::Facts;
use crate::{MCP_WAIT_S_MAX, Refusal};

/// The instructions that a client may show its model when it connects.
pub(crate) const INSTRUCTIONS: &str = "You hold one seat of a game of swarmbench: one agent of a swarm in a grid \
    world. `look` shows what your agent sees, `act` is its move in a round. Play until `look` or `act` says that the \
    game is over.";

/// The prompt `play`.
pub(crate) const PLAY: &str = "Play your seat of this game of swarmbench to its end.\n\n\
    1. Call `look` with `wait_s` 45. It shows what your agent sees, the task, and the number of the round.\n\
    2. Decide on one action. You and the other agents have the same task, and you cannot see all that they see: say \
    in `message` what helps them.\n\
    3. Call `act` with that round, the action and the message. It answers with the next observation: continue \
    at 2. If the others need longer, call `look` with `wait_s` 45 until a new round is open.\n\
    4. Stop when a tool says that the game is over, or that your agent has left the map.\n\n\
    Where an observation asks for lines that begin with ACTION and MSG, call `act` instead. An error says what to \
    change; it costs no move. Do not ask me between rounds.";

/// The description of `look`.
pub(crate) const LOOK: &str = "Shows what your agent sees now, as text, with the number of the open round. Changes \
    nothing and costs no move. With `wait_s` it first waits until the game needs your act or is over.";

/// The description of `act`.
pub(crate) const ACT: &str = "Your agent's move in the open round: one action, and a message to the agents near it if \
    you want. Every round takes one act of each agent. Answers with a receipt, and with the next observation once the \
    other agents have acted, too. The same act sent again gets the same receipt and is no second move.";

/// The next step of the model, given an observation.
pub(crate) fn next(facts: &Facts) -> String {
    let Facts { agent, status, round, max_round, score, .. } = facts;
    let wait = format!("call `look` with wait_s {MCP_WAIT_S_MAX}");
    if status.is_over() {
        return format!(
            "The game is over ({}) after round {round} of {max_round}. The score of the swarm is {score}. Nothing is \
             left to do.",
            status.name()
        );
    }
    if status.name() == "waiting" {
        return format!(
            "The game has not started: some seats have no holder yet, or its creator has not started it. To wait for \
             it, {wait}."
        );
    }
    if !facts.alive {
        return format!(
            "{agent} has left the map and has no more moves. The game continues without it, now in round {round} of \
             {max_round}. You can stop; to see the end, {wait}."
        );
    }
    if facts.acted {
        return format!(
            "You have acted in round {round}, and the round is still open: other agents have not acted yet. To wait \
             for the next round, {wait}."
        );
    }
    let clock = facts
        .remaining_ms
        .map_or_else(String::new, |left| format!(" {} seconds are left.", left / 1000));
    format!(
        "Round {round} is open, and waits for your act.{clock} Do not write ACTION and MSG as text: call `act` with \
         round {round}, one of the actions above and, if you like, a message."
    )
}

/// The confirmation of an act.
pub(crate) fn receipt(receipt: &Receipt) -> String {
    let Receipt { round, action, message, duplicate, .. } = receipt;
    let action = action.as_deref().unwrap_or("no action");
    let message = message.as_deref().map_or_else(String::new, |text| format!(", message {text:?}"));
    let when = if *duplicate { "had been recorded before; it counts once" } else { "is recorded" };
    format!("Round {round}: {action}{message} {when}.")
}

/// The text after an act that counts while the next observation cannot be shown.
pub(crate) fn receipt_alone(refusal: &Refusal) -> String {
    format!(
        "The next observation cannot be shown: {} The act counts all the same.",
        refused(refusal)
    )
}

/// The error for wrong arguments of a tool.
pub(crate) fn arguments(tool: &str, problems: &str) -> String {
    format!("{problems}. Nothing was done: correct this and call `{tool}` again.")
}

/// The error for a refusal, with advice.
pub(crate) fn refused(refusal: &Refusal) -> String {
    let problem = match refusal {
        Refusal::Problem(problem) => problem,
        Refusal::NoAnswer(text) => return sentence(text),
    };
    let Problem { detail, code, retry_after_ms, .. } = &**problem;
    let advice = match code.as_str() {
        "round_over" | "already_acted" | "round_ahead" => {
            "Call `look` and continue with the round that it shows.".to_owned()
        }
        "invalid" => "Nothing was recorded: correct this and call `act` again.".to_owned(),
        "unauthorized" | "forbidden" => {
            "Only the person who set up this connection can change it: it needs the seat token (seat_…) of one agent, \
             over HTTP in the header Authorization: Bearer, with `swarmbench mcp` in SWARMBENCH_TOKEN."
                .to_owned()
        }
        _ => retry_after_ms.map_or_else(String::new, |after| {
            format!("Try again in {} seconds.", after.div_ceil(1000))
        }),
    };
    format!("{} {advice}", sentence(detail)).trim_end().to_owned()
}

/// The replacement for a prompt that could not be made.
pub(crate) fn without_prompt(refusal: &Refusal, json: &str) -> String {
    format!("{} So this is the observation as JSON:\n{json}", refused(refusal))
}

/// A text with a capital letter and a full stop.
fn sentence(text: &str) -> String {
    let mut letters = text.chars();
    let first: String = letters.next().into_iter().flat_map(char::to_uppercase).collect();
    let end = if text.ends_with(['.', '?', '!']) { "" } else { "." };
    format!("{first}{}{end}", letters.as_str())
}
