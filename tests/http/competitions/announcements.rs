//! Announcements of organizers.

use serde_json::json;

use crate::app::{fields, list, texts};
use crate::cup::{Cup, server};

#[tokio::test]
async fn everybody_reads_announcements_and_organizers_alone_make_them() {
    let app = server().await;
    let cup = Cup::open(&app, json!({})).await;
    let other = Cup::open(&app, json!({ "name": "another cup" })).await;
    let blue = cup.enter(&app, "blue").await;
    let path = cup.path("/announcements");
    let announce =
        |text: &str| app.post(&path).token(&app.organizer).json(&json!({ "text": text }));
    assert_eq!(announce("Round one.\nGood luck").ok().await["text"], "Round one.\nGood luck");
    for number in 2..20 {
        announce(&format!("news {number}")).ok().await;
    }
    // What else organizers do is no announcement.
    cup.change(&app, &blue, json!({ "vouched": true })).await;
    let first = app.get(&format!("{path}?limit=17")).ok().await;
    let shown = texts(&list(&first["items"]), "text");
    assert_eq!((shown.len(), shown[0].as_str(), shown[16].as_str()), (17, "news 19", "news 3"));
    let cursor = first["next_cursor"].as_str().expect("there are more");
    let rest = app.get(&format!("{path}?limit=17&cursor={cursor}")).ok().await;
    assert_eq!(texts(&list(&rest["items"]), "text"), ["news 2", "Round one.\nGood luck"]);
    let of_other = app.get(&other.path("/announcements")).ok().await;
    assert_eq!(list(&of_other["items"]).len(), 0);
    let actions = app.get(&cup.path("/actions?limit=2")).ok().await;
    let actions = list(&actions["items"]);
    assert_eq!(texts(&actions, "action"), ["entrant.change", "competition.announce"]);
    assert_eq!(actions[1]["detail"], json!({ "text": "news 19" }));

    for text in ["", "  ", "a\u{1b}[31m", &"x".repeat(2_001)] {
        let problem = announce(text).problem(422, "invalid").await;
        assert_eq!(fields(&problem), ["text"], "{text:?}");
    }
    let body = json!({ "text": "I have won" });
    app.post(&path).token(&blue.key).json(&body).problem(403, "forbidden").await;
    app.post(&path).json(&body).problem(401, "unauthorized").await;
}
