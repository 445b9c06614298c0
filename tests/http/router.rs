//! The router: headers of every answer, its own pages, and the routes in the metrics.

use crate::app::TestApp;

#[tokio::test]
async fn the_page_of_the_document_needs_no_other_host() {
    let app = TestApp::start().await;
    let page = app.get("/docs").send().await;
    assert_eq!((page.status, page.header("content-type")), (200, "text/html; charset=utf-8"));
    let page = page.text();
    let mut files = 0;
    // The files are named relative to a base on this server.
    let (_, base) = page.split_once("<base href=\"").expect("a base");
    let (base, links) = base.split_once('"').expect("a value");
    assert!(base.starts_with("/docs/"), "{base}");
    let links = ["src=\"", "href=\""].into_iter().flat_map(|name| links.split(name).skip(1));
    for link in links {
        let target = link.split('"').next().expect("a value");
        assert!(!target.starts_with('/') && !target.contains(':'), "{target}");
        let target = &format!("{base}{}", target.trim_start_matches("./"));
        let file = app.get(target).send().await;
        let media_type = match target.rsplit('.').next() {
            Some("css") => "text/css",
            Some("js") => "text/javascript",
            _ => "image/png",
        };
        assert_eq!((file.status, file.header("content-type")), (200, media_type), "{target}");
        if target.ends_with("initializer.js") {
            let script = file.text();
            assert!(script.contains("/openapi.json") && !script.contains("http"), "{script}");
        }
        files += 1;
    }
    assert!(files >= 4, "{page}");
    assert!(!page.contains("//"), "{page}");
    assert_eq!(app.get("/docs/files/nothing.js").send().await.status, 404);
}

#[tokio::test]
async fn every_answer_has_the_id_of_its_request() {
    let app = TestApp::start().await;
    let mut ids = Vec::new();
    for route in ["/healthz", "/obs", "/nowhere", "/docs"] {
        let answer = app.get(route).send().await;
        let id = answer.header("x-request-id").to_owned();
        assert!(id.len() >= 16, "{route}: {id:?}");
        ids.push(id);
    }
    ids.sort();
    ids.dedup();
    assert_eq!(ids.len(), 4);
    let answer = app.get("/healthz").header("x-request-id", "mine-7").send().await;
    assert_eq!(answer.header("x-request-id"), "mine-7");
    let longest = "x".repeat(200);
    let answer = app.get("/healthz").header("x-request-id", &longest).send().await;
    assert_eq!(answer.header("x-request-id"), longest);
    // It would be logged and sent back.
    for bad in [&*format!("{longest}x"), &"x".repeat(8000), "two words", ""] {
        let answer = app.get("/healthz").header("x-request-id", bad).send().await;
        let id = answer.header("x-request-id");
        assert!(id.len() < 40 && id.len() >= 16 && id != bad, "{id:?}");
    }
}

#[tokio::test]
async fn the_front_page_needs_no_other_host_and_trusts_no_names() {
    let app = TestApp::start().await;
    let page = app.get("/").send().await;
    assert_eq!((page.status, page.header("content-type")), (200, "text/html; charset=utf-8"));
    let page = page.text();
    for link in page.split("href=\"").skip(1) {
        let target = link.split('"').next().expect("a value");
        assert_eq!(app.get(target).send().await.status, 200, "{target}");
    }
    // What creators have named is set as text, never as markup.
    for banned in ["http:", "https:", "innerHTML", "document.write"] {
        assert!(!page.contains(banned), "{banned}");
    }
}

#[tokio::test]
async fn clients_do_not_name_what_is_counted() {
    let app = TestApp::start().await;
    for path in ["/healthz", "/nowhere", "/obs"] {
        for method in ["BREW", "PUT", "TRACE"] {
            let method = method.parse().expect("a method");
            app.call(method, path).send().await;
        }
    }
    app.get("/healthz").ok().await;
    let metrics = app.get("/metrics").send().await.text();
    assert!(metrics.contains("route=\"/healthz\",method=\"GET\""), "{metrics}");
    for thought_up in ["BREW", "PUT", "nowhere", "route=\"none\""] {
        assert!(!metrics.contains(thought_up), "{thought_up}: {metrics}");
    }
}
