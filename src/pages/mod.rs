//! The files that pages load, from `static/assets`, which are part of the program; and a page that needs no server.

mod single;

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::Write;
use std::sync::LazyLock;

use bytes::Bytes;
use flate2::Compression;
use flate2::write::GzEncoder;
use rust_embed::RustEmbed;
use sha2::{Digest, Sha256};
use swarmbench_protocol::names::printable;

pub use single::single_page;

/// Bytes of the digest that identifies all files: enough that two versions never share one.
const VERSION_BYTES: usize = 8;

#[derive(RustEmbed)]
#[folder = "static/assets"]
struct Embedded;

/// All files of the program, compressed when they are first needed.
pub static FILES: LazyLock<Files> = LazyLock::new(Files::embedded);

/// Files by their names.
pub struct Files {
    /// Identifies the content of all files together. It is part of their addresses, so that browsers may keep them for
    /// ever, and files that import each other are always of one version.
    pub version: String,
    by_name: BTreeMap<String, File>,
}

/// The content of a file.
pub struct File {
    /// As it is in `static/assets`, but scripts without comments.
    pub plain: Bytes,
    /// The same, compressed by gzip.
    pub compressed: Bytes,
}

impl Files {
    fn embedded() -> Self {
        let mut hash = Sha256::new();
        let mut by_name = BTreeMap::new();
        let mut names: Vec<Cow<'static, str>> = Embedded::iter().collect();
        names.sort();
        for name in names {
            let mut data = Embedded::get(&name).expect("it is listed").data.into_owned();
            if is_script(&name) {
                data = without_comments(&String::from_utf8(data).expect("it is text")).into_bytes();
            }
            for part in [name.as_bytes(), &data] {
                hash.update((part.len() as u64).to_be_bytes());
                hash.update(part);
            }
            let plain = Bytes::from(data);
            let compressed = compress(&plain);
            by_name.insert(name.into_owned(), File { plain, compressed });
        }
        let version = data_encoding::HEXLOWER.encode(&hash.finalize()[..VERSION_BYTES]);
        Self { version, by_name }
    }

    /// The file with this name, such as `pages/board.js`.
    pub fn get(&self, name: &str) -> Option<&File> {
        self.by_name.get(name)
    }

    /// The content of a file of text.
    fn text(&self, name: &str) -> Option<&str> {
        std::str::from_utf8(&self.get(name)?.plain).ok()
    }
}

/// Whether a file is one of the project's scripts; those of libraries keep their licences.
fn is_script(name: &str) -> bool {
    matches!(name.rsplit_once('.'), Some((_, "js")))
}

/// A script without the lines that are comments, which are a fifth of what a first visit loads. Lines keep their numbers.
fn without_comments(script: &str) -> String {
    let mut kept = String::with_capacity(script.len());
    let mut in_comment = false;
    for line in script.lines() {
        let text = line.trim();
        let begins =
            text.starts_with("/**") && text.find("*/").is_none_or(|end| end + 2 == text.len());
        if !(in_comment || begins || text.starts_with("// ")) {
            kept.push_str(line);
        }
        if in_comment || begins {
            in_comment = !text.ends_with("*/");
        }
        kept.push('\n');
    }
    kept
}

fn compress(plain: &[u8]) -> Bytes {
    let mut compressed = GzEncoder::new(Vec::new(), Compression::best());
    let done = compressed.write_all(plain).and_then(|()| compressed.finish());
    done.expect("writing to memory does not fail").into()
}

/// A text for markup: what would be markup is escaped, and what cannot be seen is shown as `U+FFFD`.
pub fn escape(text: &str) -> String {
    let mut escaped = String::with_capacity(text.len());
    for c in printable(text).chars() {
        match c {
            '&' => escaped.push_str("&amp;"),
            '<' => escaped.push_str("&lt;"),
            '>' => escaped.push_str("&gt;"),
            '"' => escaped.push_str("&quot;"),
            '\'' => escaped.push_str("&#39;"),
            c => escaped.push(c),
        }
    }
    escaped
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn comments_are_left_out_of_scripts_and_lines_keep_their_numbers() {
        let script = "// What it is.\n/**\n * @param {number} a\n */\nlet a = 1; // one\n  /** b */\n\
            /** @type {any} */ (a);\nlet c = \"// \";\n";
        let kept = "\n\n\n\nlet a = 1; // one\n\n/** @type {any} */ (a);\nlet c = \"// \";\n";
        assert_eq!(without_comments(script), kept);
    }
}
