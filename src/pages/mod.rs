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
use swarmbench_figures::scene::printable;

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
    /// As it is in `static/assets`.
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
            let file = Embedded::get(&name).expect("it is listed");
            for part in [name.as_bytes(), &file.data] {
                hash.update((part.len() as u64).to_be_bytes());
                hash.update(part);
            }
            let plain = Bytes::from(file.data.into_owned());
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
