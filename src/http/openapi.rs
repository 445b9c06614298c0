//! The OpenAPI document: generated from the handlers, committed, and compared by a test.

/// The document as committed and served.
///
/// # Panics
/// Never: the document has string keys.
pub fn document() -> String {
    let mut text = super::router::routes().to_openapi().to_pretty_json().expect("string keys");
    text.push('\n');
    text
}
