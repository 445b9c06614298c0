//! Observations as text for language models.
//!
//! The crate is separate so that tools can render the server's prompts without a server. Without its feature `render`
//! it has the templates and the names of prompts, and no template engine.
//!
//! A prompt is a template (minijinja) filled with the observation of one seat. The built-in template has the sections
//! of the paper's Appendix "Prompt Design" in its order. An episode may bring its own, which is untrusted: it is
//! checked when the episode is created and bounded when it runs:
//!
//! - the template may print, branch and loop over its input, with a few filters, but build no larger values: no
//!   assignments, no lists, no calls, no concatenation, no includes;
//! - its tokens are counted before it is parsed, so that its nesting cannot overflow a stack;
//! - its instructions, the bytes that it reads and the bytes that it writes are bounded.

mod identity;
#[cfg(feature = "render")]
mod render;
pub mod tasks;

pub use identity::Identity;
#[cfg(feature = "render")]
pub use render::{
    PROMPT_BYTES_MAX, PROMPT_BYTES_PER_CELL_MAX, PROMPT_JSON_FACTOR_MAX, TEMPLATE_BYTES_MAX,
    TEMPLATE_CHAIN_MAX, TEMPLATE_ELIF_MAX, TEMPLATE_NESTING_MAX, TEMPLATE_UNARY_MAX, TemplateError,
    check, render,
};

/// The built-in template.
pub const BUILT_IN: &str = include_str!("prompt.txt.j2");

/// The template `toolkit`: the content of the public toolkit's prompt, in its order and form and in our own words.
pub const TOOLKIT: &str = include_str!("toolkit.txt.j2");

/// The template `static-first`: the words of the built-in one, with all that no agent and no round changes at the beginning, which
/// caches of prompts share.
pub const STATIC_FIRST: &str = include_str!("static_first.txt.j2");

/// The names of templates beside `default`, and their texts.
pub const NAMED: [(&str, &str); 2] = [("toolkit", TOOLKIT), ("static-first", STATIC_FIRST)];

/// The revision of the program's own words: the built-in template, the descriptions of the tasks and the meanings of
/// the actions. Any change of them is a new revision, since a model may play differently.
pub const REVISION: u32 = 2;

/// The text of a template given by its text or by its [name](NAMED); `None` for the built-in one, which has the name `default`.
#[must_use]
pub fn chosen(asked: Option<String>) -> Option<String> {
    asked.filter(|name| name != "default").map(|name| {
        let named = NAMED.iter().find(|(known, _)| *known == name);
        named.map_or(name, |(_, text)| (*text).to_owned())
    })
}
