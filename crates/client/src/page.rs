//! Pages that proxies answer with, as a few words for an error.

/// Maximum characters of a page that an error shows.
const TEXT_CHARS_MAX: usize = 200;

/// The first printable text of a page: no markup, scripts or styles, and one space where there were several or a control
/// character.
pub(super) fn first_text(body: &[u8]) -> String {
    let page = String::from_utf8_lossy(body);
    let (before, marked) = page.split_once('<').unwrap_or((&page, ""));
    let marked = marked.split('<').filter_map(text_of);
    let words = std::iter::once(before).chain(marked).flat_map(|text| {
        text.split(|char: char| char.is_whitespace() || char.is_control())
            .filter(|word| !word.is_empty())
    });
    let mut text = String::new();
    for word in words {
        if !text.is_empty() {
            text.push(' ');
        }
        text.push_str(word);
    }
    if text.is_empty() { "no text".to_owned() } else { text.chars().take(TEXT_CHARS_MAX).collect() }
}

/// The text behind a tag, whose name is at the beginning of `piece`.
fn text_of(piece: &str) -> Option<&str> {
    let (tag, text) = piece.split_once('>')?;
    let name = tag.split(|char: char| !char.is_ascii_alphanumeric()).next().unwrap_or_default();
    let is_hidden = ["script", "style"].iter().any(|hidden| name.eq_ignore_ascii_case(hidden));
    (!is_hidden).then_some(text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_shows_the_words_of_a_page() {
        let pages: [(&str, &str); 6] = [
            (
                "<html><body><h1>502 Bad Gateway</h1>\nThe server returned an invalid response.\n</body></html>",
                "502 Bad Gateway The server returned an invalid response.",
            ),
            ("<style>h1 { color: red }</style><script>a()</script>\r\n<h1>gone</h1>", "gone"),
            ("upstream connect error", "upstream connect error"),
            ("a\u{1b}[31mred\u{7}", "a [31mred"),
            ("<html", "no text"),
            ("", "no text"),
        ];
        for (page, text) in pages {
            assert_eq!(first_text(page.as_bytes()), text, "{page:?}");
        }
        let long = format!("<p>{}", "ä".repeat(10 * TEXT_CHARS_MAX));
        assert_eq!(first_text(long.as_bytes()), "ä".repeat(TEXT_CHARS_MAX));
    }
}
