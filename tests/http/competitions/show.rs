//! The page of a competition, from its commitment to its revealed seeds.

use serde_json::{Value, json};

use crate::app::list;
use crate::cup::{Cup, pass_minutes, server};

#[tokio::test]
async fn the_commitment_is_there_from_the_beginning_and_the_seeds_are_not() {
    let mut app = server().await;
    let cup = Cup::with(&app, json!({})).await;
    let commitment = cup.created["commitment"].as_str().expect("a text").to_owned();
    assert_eq!(commitment.len(), 64);
    let shown = cup.show(&app).await;
    assert_eq!(shown, cup.created);
    assert_eq!((&shown["phase"], &shown["salt"]), (&json!("announced"), &Value::Null));
    assert_eq!(shown["seeds"], Value::Null);
    let listed = app.get("/api/v1/competitions").ok().await;
    assert_eq!(list(&listed["items"]), [shown]);
    app.restart().await;
    pass_minutes(&app, 10).await;
    assert_eq!(cup.show(&app).await["phase"], "open");
    // Nobody plays, so it is closed as soon as its time is over.
    pass_minutes(&app, 50).await;
    let closed = cup.closed(&app).await;
    assert_eq!(closed["commitment"], commitment.as_str());
    let hex = |text: &Value| {
        data_encoding::HEXLOWER.decode(text.as_str().expect("text").as_bytes()).expect("hex")
    };
    let seeds: Vec<u8> = list(&closed["seeds"]).iter().flat_map(hex).collect();
    assert_eq!(seeds.len(), 2 * 2 * 16);
    let hash = <sha2::Sha256 as sha2::Digest>::digest([hex(&closed["salt"]), seeds].concat());
    assert_eq!(data_encoding::HEXLOWER.encode(&hash), commitment);
}
