//! Static files of the web pages, embedded from `static/assets`, and a standalone page that needs no server.

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

/// Bytes of the digest that identifies a version of all files: enough that two versions never share one.
const VERSION_BYTES: usize = 8;

#[derive(RustEmbed)]
#[folder = "static/assets"]
struct Embedded;

/// All embedded files, compressed at the first use.
pub static FILES: LazyLock<Files> = LazyLock::new(Files::embedded);

/// Files by their names.
pub struct Files {
    /// Digest of all files. Part of their addresses, so that browsers may cache them forever, and files that import each
    /// other always have one version.
    pub version: String,
    by_name: BTreeMap<String, File>,
}

/// The content of a file.
pub struct File {
    /// Content in `static/assets`; scripts without comments.
    pub plain: Bytes,
    /// Content compressed by gzip.
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

    /// Finds a file by its name, such as `pages/board.js`.
    pub fn get(&self, name: &str) -> Option<&File> {
        self.by_name.get(name)
    }

    /// Content of a text file.
    fn text(&self, name: &str) -> Option<&str> {
        std::str::from_utf8(&self.get(name)?.plain).ok()
    }
}

/// Whether a file is one of the project's scripts (`.js`). Those of libraries (`.mjs`) keep their licences.
fn is_script(name: &str) -> bool {
    matches!(name.rsplit_once('.'), Some((_, "js")))
}

/// Empties the lines of a script that are comments, and leaves out types within lines: a fifth of the bytes of a first visit.
/// Line numbers stay the same.
fn without_comments(script: &str) -> String {
    let mut kept = String::with_capacity(script.len());
    let mut in_comment = false;
    for line in script.lines() {
        let text = line.trim();
        let begins =
            text.starts_with("/**") && text.find("*/").is_none_or(|end| end + 2 == text.len());
        if !(in_comment || begins || text.starts_with("// ")) {
            push_without_types(&mut kept, line);
        }
        if in_comment || begins {
            in_comment = !text.ends_with("*/");
        }
        kept.push('\n');
    }
    kept
}

/// Appends a line of a script without comments such as `/** @type {number} */`.
fn push_without_types(kept: &mut String, mut line: &str) {
    while let Some((code, rest)) = line.split_once("/** @type ") {
        let Some((_, after)) = rest.split_once("*/") else { break };
        kept.push_str(code);
        line = after.strip_prefix(' ').unwrap_or(after);
    }
    kept.push_str(line);
}

fn compress(plain: &[u8]) -> Bytes {
    let mut compressed = GzEncoder::new(Vec::new(), Compression::best());
    let done = compressed.write_all(plain).and_then(|()| compressed.finish());
    done.expect("writing to memory does not fail").into()
}

/// Escapes a text for HTML; invisible characters become `U+FFFD`.
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
            /** @type {any} */ (a);\nlet c = \"// \";\nf((/** @type {{b: any}} */ d) => /** @type {E} */ (d));\n";
        let kept = "\n\n\n\nlet a = 1; // one\n\n(a);\nlet c = \"// \";\nf((d) => (d));\n";
        assert_eq!(without_comments(script), kept);
    }
}
