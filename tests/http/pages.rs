//! Pages and their files: who may keep them, what they may do, and what their documents say before any script runs.

use rstest::rstest;
use serde_json::json;

use crate::app::{HttpAnswer, TestApp, game};

const BROWSER: &str = "text/html,application/xhtml+xml,application/xml;q=0.9,*/*;q=0.8";

/// A model's name that would be markup.
const HOSTILE: &str = "<script>alert(1)</script>\"'&{links}";

async fn page(app: &TestApp, address: &str) -> HttpAnswer {
    app.get(address).header("accept", BROWSER).send().await
}

/// Title and description of a page.
fn head(page: &HttpAnswer) -> String {
    page.text().split("</head>").next().expect("a part").to_owned()
}

/// The address of a file, as the front page names it.
async fn file(app: &TestApp, name: &str) -> String {
    let page = page(app, "/").await.text();
    let (before, _) = page.split_once(name).expect("the page loads it");
    let (_, folder) = before.rsplit_once('"').expect("an attribute");
    format!("{folder}{name}")
}

#[rstest]
#[case("/", "'none'")]
#[case("/episodes/ep_0", "'none'")]
#[case("/desk", "'none'")]
#[case("/nowhere", "'none'")]
#[case("/embed/episodes/ep_0", "*")]
#[tokio::test]
async fn a_page_may_load_from_its_server_alone(#[case] address: &str, #[case] framed_by: &str) {
    let app = TestApp::start().await;
    let page = page(&app, address).await;
    let policy = page.header("content-security-policy");
    for part in [
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "connect-src 'self'",
        "base-uri 'none'",
        "form-action 'none'",
        "require-trusted-types-for 'script'",
        "trusted-types streams",
        &format!("frame-ancestors {framed_by}"),
    ] {
        assert!(policy.split("; ").any(|found| found == part), "{address}: {part}: {policy}");
    }
    assert!(!policy.contains("unsafe"), "{policy}");
    assert_eq!(page.header("referrer-policy"), "no-referrer");
    assert_eq!(page.header("x-content-type-options"), "nosniff");
    assert_eq!(page.header("cross-origin-opener-policy"), "same-origin");
    assert_eq!(page.header("cache-control"), "no-cache");
    // Everything of the page itself is in files.
    let document = page.text();
    for inline in ["<style", " style=", " onload=", "<script>"] {
        assert!(!document.contains(inline), "{address}: {inline}");
    }
}

#[tokio::test]
async fn files_are_kept_for_ever_under_their_version() {
    let app = TestApp::start().await;
    let address = file(&app, "/app.js").await;
    let plain = app.get(&address).send().await;
    assert_eq!(plain.header("content-type"), "text/javascript; charset=utf-8");
    assert_eq!(plain.header("cache-control"), "public, max-age=31536000, immutable");
    assert_eq!(plain.header("vary"), "accept-encoding");
    let packed = app.get(&address).header("accept-encoding", "gzip").open().await;
    assert_eq!(packed.headers()["content-encoding"], "gzip");
    let packed = packed.bytes().await.expect("a body");
    assert!(packed.len() < plain.text().len() / 2, "{} bytes", packed.len());
    let (_, rest) = address[1..].split_once('/').expect("a folder");
    let (version, name) = rest.split_once('/').expect("a version");
    let other = version.replace(char::is_alphanumeric, "0");
    for unknown in [format!("/assets/{other}/{name}"), format!("/assets/{version}/nothing.js")] {
        app.get(&unknown).problem(404, "not_found").await;
    }
}

#[tokio::test]
async fn browsers_get_a_page_where_nothing_is_and_programs_a_problem() {
    let app = TestApp::start().await;
    let missing = page(&app, "/nowhere").await;
    assert_eq!((missing.status, missing.header("content-type")), (404, "text/html; charset=utf-8"));
    app.get("/nowhere").problem(404, "not_found").await;
    app.get("/api/v1/nothing").header("accept", BROWSER).problem(404, "not_found").await;
}

#[tokio::test]
async fn names_are_text_in_documents() {
    let app = TestApp::start().await;
    let mut request = game(2, 4);
    request["model"] = json!(HOSTILE);
    let episode = app.create(request).await;
    let shown = page(&app, &format!("/episodes/{}", episode.id)).await.text();
    assert!(!shown.contains("<script>"), "{shown}");
    assert!(shown.contains("&lt;script&gt;alert(1)&lt;/script&gt;"), "{shown}");
    assert!(shown.contains("{links}"), "{shown}");
    for address in
        ["/board/%3Cscript%3E%22", "/runs/%3Cscript%3E%22", "/board/a%E2%80%AEb/%3Cscript%3E"]
    {
        let shown = page(&app, address).await.text();
        assert!(!shown.contains("<script>") && !shown.contains("script>\""), "{address}: {shown}");
        assert!(!shown.contains('\u{202e}'), "{address}: {shown}");
    }
}

#[tokio::test]
async fn documents_of_games_say_nothing_to_strangers() {
    let app = TestApp::builder().keys().access(|access| access.private = true).start().await;
    let mut request = game(2, 4);
    request["model"] = json!("a-secret-model");
    let episode = app.create_with(&app.organizer, request).await;
    for prefix in ["", "/embed"] {
        let shown = page(&app, &format!("{prefix}/episodes/{}", episode.id)).await;
        let unknown = page(&app, &format!("{prefix}/episodes/ep_0")).await;
        assert_eq!((shown.status, head(&shown)), (unknown.status, head(&unknown)));
        assert!(!shown.text().contains("a-secret-model"));
    }
    let known = app
        .get(&format!("/episodes/{}", episode.id))
        .header("accept", BROWSER)
        .token(&app.organizer)
        .send()
        .await
        .text();
    assert!(known.contains("a-secret-model"), "{known}");
}
