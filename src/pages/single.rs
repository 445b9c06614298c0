//! A page with everything in it: it opens without a server.

use std::collections::{BTreeMap, BTreeSet};

use data_encoding::BASE64;
use regex_lite::{Captures, Regex};
use sha2::{Digest, Sha256};

use super::{FILES, Files};

/// The module that shows the game of a page without a server.
const ENTRY: &str = "file.js";

/// The style sheets of such a page.
const STYLES: [&str; 2] = ["app.css", "pages/episode.css"];

/// What comes before the path of a module in the names under which modules of a page without a server know each other:
/// relative names mean nothing in modules that have no address.
const NAMESPACE: &str = "swarmbench/";

/// A page that shows a game, which is JSON as `static/assets/file.js` reads it. Nothing in the game is markup or a script.
pub fn single_page(title: &str, game: &serde_json::Value) -> String {
    let modules = Modules::of(&FILES, ENTRY);
    let imports = serde_json::json!({ "imports": modules.addresses() }).to_string();
    let entry = format!("import \"{NAMESPACE}{ENTRY}\";");
    let styles: String = STYLES.iter().filter_map(|name| FILES.text(name)).collect();
    let title = super::escape(title);
    let style_hash = hash(&styles);
    // In JSON a `<` is found in texts alone, where it may be written as a number.
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

/// What allows the scripts of a page. The modules are addresses with content (`data:`), which a policy can only allow all
/// together; but what a script with a nonce imports has its nonce. A text in the page would have to hold a digest of itself
/// to have it, too.
fn nonce(page: [&String; 3]) -> String {
    let digest = page.iter().fold(Sha256::new(), Sha256::chain_update);
    BASE64.encode(&digest.finalize()[..18])
}

/// The source of a policy that allows an inline style with exactly this content.
fn hash(content: &str) -> String {
    format!("'sha256-{}'", BASE64.encode(&Sha256::digest(content)))
}

/// Modules by their names, with the names of those that they import.
struct Modules(BTreeMap<String, String>);

impl Modules {
    /// A module and all that it imports, at once or through others.
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

    /// The modules as addresses that contain them, by the names under which they are imported.
    fn addresses(&self) -> BTreeMap<String, String> {
        let address = |(name, source): (&String, &String)| {
            let content = BASE64.encode(source.as_bytes());
            (format!("{NAMESPACE}{name}"), format!("data:text/javascript;base64,{content}"))
        };
        self.0.iter().map(address).collect()
    }
}

/// The name of a file that `from` names relative to itself.
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
