//! Small texts that are large when they are read: one part many times, side by side or one within another.

/// A text around something that is repeated.
pub(super) struct Shape {
    pub(super) before: &'static str,
    pub(super) part: &'static str,
    pub(super) middle: &'static str,
    /// Comes once for each part, after the middle.
    pub(super) closing: &'static str,
    pub(super) after: &'static str,
}

const fn chain(before: &'static str, part: &'static str, after: &'static str) -> Shape {
    Shape { before, part, middle: "", closing: "", after }
}

const fn nest(part: &'static str, middle: &'static str, closing: &'static str) -> Shape {
    Shape { before: "", part, middle, closing, after: "" }
}

const fn within(part: &'static str, closing: &'static str) -> Shape {
    Shape { before: "{{ ", part, middle: "1", closing, after: " }}" }
}

impl Shape {
    /// The text with so many parts, or with as many as fit into `bytes_max`.
    pub(super) fn of(&self, parts: usize, bytes_max: usize) -> String {
        let Self { before, part, middle, closing, after } = self;
        let around = before.len() + middle.len() + after.len();
        let parts = parts.min((bytes_max - around) / (part.len() + closing.len()));
        let (parts, closings) = (part.repeat(parts), closing.repeat(parts));
        [before, parts.as_str(), middle, closings.as_str(), after].concat()
    }
}

/// Templates which a parser or a compiler may follow by recursion.
pub(super) const TEMPLATES: [Shape; 27] = [
    within("not ", ""),
    within("- ", ""),
    within("not -", ""),
    within("(", ")"),
    within("[", "]"),
    within("{1:", "}"),
    within("1|default(", ")"),
    within("1 is eq(", ")"),
    within("1 if 1 else ", ""),
    within("agent[", "]"),
    chain("{{ agent", ".i", " }}"),
    chain("{{ agent", "[0]", " }}"),
    chain("{{ agent", "[:1]", " }}"),
    chain("{{ agent", "()", " }}"),
    chain("{{ agent", "|trim", " }}"),
    chain("{{ agent", " is defined", " }}"),
    chain("{{ 1", "-1", " }}"),
    chain("{{ 1", " and 1", " }}"),
    chain("{{ 1", " or 1", " }}"),
    chain("{{ 1", "<1", " }}"),
    chain("{{ agent", " in agent", " }}"),
    chain("{{ 1", " if 1", " }}"),
    chain("{% if 0 %}", "{% elif 0 %}", "{% endif %}"),
    nest("{% if 1 %}", "x", "{% endif %}"),
    nest("{% if 0 %}{% else %}", "x", "{% endif %}"),
    nest("{% for a in actions %}", "x", "{% endfor %}"),
    chain("", "{{ agent }}", ""),
];

/// Repetitions of a part of a template: around what may be a limit, and where stacks end.
pub(super) const PARTS: [usize; 10] = [17, 33, 65, 151, 1_000, 2_334, 4_000, 8_100, 11_031, 32_768];

/// JSON that takes many times its bytes where it is read into values.
pub(super) const JSON: [Shape; 9] = [
    chain("{\"x\":[0", ",{\"\":0}", "]}"),
    chain("{\"x\":[0", ",{\"\":{}}", "]}"),
    chain("{\"x\":[0", ",[[]]", "]}"),
    chain("{\"x\":[0", ",[]", "]}"),
    chain("{\"x\":[0", ",0", "]}"),
    chain("{\"x\":[0", ",1e300", "]}"),
    chain("{\"x\":[0", ",\"\"", "]}"),
    chain("{\"x\":\"", "\\u0001", "\"}"),
    Shape { before: "{\"x\":", part: "{\"\":", middle: "0", closing: "}", after: "}" },
];

/// An object with so many fields that nobody knows.
pub(super) fn unknown_fields(count: usize) -> String {
    let fields: Vec<_> = (0..count).map(|number| format!("\"{number:x}\":0")).collect();
    format!("{{{}}}", fields.join(","))
}
