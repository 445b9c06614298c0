//! A standalone page: one HTML file with everything in it.

use std::collections::{BTreeMap, BTreeSet};

use data_encoding::BASE64;
use regex_lite::{Captures, Regex};
use sha2::{Digest, Sha256};

use super::{FILES, Files};

/// Entry module of a standalone page.
const ENTRY: &str = "file.js";

/// Style sheets of a standalone page.
const STYLES: [&str; 2] = ["app.css", "pages/episode.css"];

/// Prefix of the names by which embedded modules import each other: `data:` modules have no address to which a relative name
/// could refer.
const NAMESPACE: &str = "swarmbench/";

/// A standalone page that shows a game in the JSON format of `static/assets/file.js`. No part of the game can act as markup
/// or a script.
pub fn single_page(title: &str, game: &serde_json::Value) -> String {
    let modules = Modules::of(&FILES, ENTRY);
    let imports = serde_json::json!({ "imports": modules.addresses() }).to_string();
    let entry = format!("import \"{NAMESPACE}{ENTRY}\";");
    let styles: String = STYLES.iter().filter_map(|name| FILES.text(name)).collect();
    let title = super::escape(title);
    let style_hash = hash(&styles);
    // In JSON, `<` occurs only in texts, where it may be escaped.
    let game = game.to_string().replace('<', "\\u003c");
    let nonce = nonce([&title, &imports, &game]);
    format!(
        "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
         <meta name=\"color-scheme\" content=\"light dark\">\n\
         <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; script-src 'nonce-{nonce}'; \
         style-src {style_hash}; img-src data: blob:; base-uri 'none'; form-action 'none'; \
         require-trusted-types-for 'script'; trusted-types 'none'\">\n\
         <title>{title}</title>\n<style>{styles}</style>\n\
         <script type=\"importmap\" nonce=\"{nonce}\">{imports}</script>\n</head>\n<body>\n<div id=\"app\"></div>\n\
         <noscript><h1>{title}</h1><p>This page shows a recorded game, and needs scripts.</p></noscript>\n\
         <script type=\"application/json\" id=\"game\">{game}</script>\n\
         <script type=\"module\" nonce=\"{nonce}\">{entry}</script>\n</body>\n</html>\n"
    )
}

/// The nonce of a page's scripts. Modules are `data:` addresses, which a policy can only allow all together; but imports of a
/// script with a nonce are allowed by it. The nonce is a digest of the page, so a text in the page cannot contain it.
fn nonce(page: [&String; 3]) -> String {
    let digest = page.iter().fold(Sha256::new(), Sha256::chain_update);
    BASE64.encode(&digest.finalize()[..18])
}

/// A source expression of the policy that allows one inline style.
fn hash(content: &str) -> String {
    format!("'sha256-{}'", BASE64.encode(&Sha256::digest(content)))
}

/// Sources of modules by name, with imports renamed.
struct Modules(BTreeMap<String, String>);

impl Modules {
    /// A module and all its direct and indirect imports.
    fn of(files: &Files, entry: &str) -> Self {
        let import = Regex::new(r#"\b(from|import)\s*"(\.{1,2}/[^"]+)""#).expect("a good pattern");
        let mut modules = BTreeMap::new();
        let mut missing = BTreeSet::from([entry.to_owned()]);
        while let Some(name) = missing.pop_first() {
            let source = files.text(&name).unwrap_or_default();
            let mut imported = Vec::new();
            let source = import.replace_all(source, |found: &Captures<'_>| {
                let target = resolved(&name, &found[2]);
                let renamed = format!("{} \"{NAMESPACE}{target}\"", &found[1]);
                imported.push(target);
                renamed
            });
            modules.insert(name.clone(), source.into_owned());
            missing.extend(imported.into_iter().filter(|name| !modules.contains_key(name)));
        }
        Self(modules)
    }

    /// Modules as `data:` addresses, by the names of their imports.
    fn addresses(&self) -> BTreeMap<String, String> {
        let address = |(name, source): (&String, &String)| {
            let content = BASE64.encode(source.as_bytes());
            (format!("{NAMESPACE}{name}"), format!("data:text/javascript;base64,{content}"))
        };
        self.0.iter().map(address).collect()
    }
}

/// Resolves a relative name in the file `from`.
fn resolved(from: &str, relative: &str) -> String {
    let mut parts: Vec<&str> = from.split('/').collect();
    parts.pop();
    for part in relative.split('/') {
        match part {
            "." => {}
            ".." => drop(parts.pop()),
            part => parts.push(part),
        }
    }
    parts.join("/")
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn names_are_relative_to_the_module_that_imports() {
        assert_eq!(resolved("file.js", "./ui.js"), "ui.js");
        assert_eq!(resolved("parts/map.js", "../ui.js"), "ui.js");
        assert_eq!(resolved("parts/map.js", "./text.js"), "parts/text.js");
    }

    #[test]
    fn all_modules_are_in_the_page_and_name_no_files() {
        let modules = Modules::of(&FILES, ENTRY);
        assert!(modules.0.contains_key("vendor/preact.mjs"));
        for (name, source) in &modules.0 {
            assert!(!source.is_empty(), "{name} is missing");
            for relative in ["from\"./", "from \"./", "from \"../", "import(", "import.meta"] {
                assert!(!source.contains(relative), "{name}: {relative}");
            }
        }
    }

    #[test]
    fn the_policy_allows_the_scripts_of_the_page_alone() {
        let page = |said: &str| single_page("A game", &json!({ "said": said }));
        let nonce = |page: &str| {
            let start = page.split_once("'nonce-").expect("a nonce").1;
            start.split_once('\'').expect("an end").0.to_owned()
        };
        let (one, other) = (page("a"), page("b"));
        assert!(!one.contains("data: 'nonce") && !one.contains("script-src data:"));
        assert!(one.contains("; script-src 'nonce-"));
        assert_eq!(one.matches(&format!(" nonce=\"{}\"", nonce(&one))).count(), 2);
        assert_ne!(nonce(&one), nonce(&other));
    }

    #[test]
    fn a_game_is_never_markup() {
        let page =
            single_page("</title><b>", &json!({"said": "</script><script>alert(1)</script>"}));
        assert!(!page.contains("</script><script>alert"));
        assert!(page.contains(r"\u003c/script>"));
        assert!(page.contains("<title>&lt;/title&gt;&lt;b&gt;</title>"));
    }
}
