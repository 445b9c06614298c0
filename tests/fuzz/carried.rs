//! JSON that is only carried is what a tree of values would write.

use std::fmt::Write as _;

use proptest::prelude::*;
use serde_json::{Value, json};
use swarmbench_protocol::carried::Carried;

/// JSON as clients may write it: numbers of all kinds, escapes, spaces, names that come twice.
fn some_json() -> impl Strategy<Value = String> {
    let numbers = [
        "0",
        "-0",
        "1.0",
        "1e3",
        "-1.5E-7",
        "18446744073709551615",
        "18446744073709551616",
        "-9223372036854775809",
        "0.1",
        "123456789012345678901234567890",
        "1e308",
        "5e-324",
        "3.0000000000000001",
    ];
    let texts = [
        r#""""#,
        r#""a""#,
        r#""\u0061""#,
        r#""\u00e9\ud83d\ude00""#,
        r#""é😀""#,
        r#""\n\/\\\"""#,
        r#""\u0000\u001f\u007f""#,
        r#"" ""#,
        r#""b""#,
        r#""A""#,
    ];
    let name = prop::sample::select(texts.to_vec());
    let leaf = prop_oneof![
        prop::sample::select(vec!["null", "true", "false"]).prop_map(str::to_owned),
        prop::sample::select(numbers.to_vec()).prop_map(str::to_owned),
        any::<f64>()
            .prop_filter("JSON has no others", |f| f.is_finite())
            .prop_map(|f| format!("{f:e}")),
        any::<i64>().prop_map(|i| i.to_string()),
        name.clone().prop_map(str::to_owned),
        ".{0,12}".prop_map(|text| json!(text).to_string()),
    ];
    leaf.prop_recursive(6, 64, 8, move |inner| {
        let members = prop::collection::vec((name.clone(), inner.clone()), 0..8);
        prop_oneof![
            prop::collection::vec(inner, 0..8).prop_map(|all| format!("[ {} ]", all.join(" ,\n"))),
            members.prop_map(|all| {
                let mut text = String::new();
                for (place, (name, value)) in all.iter().enumerate() {
                    let comma = if place == 0 { "" } else { "," };
                    write!(text, "{comma} {name}\t: {value}").expect("a text");
                }
                format!("{{{text}}}")
            }),
        ]
    })
}

proptest! {
    #[test]
    fn what_is_carried_is_what_a_tree_of_values_would_write(json in some_json()) {
        let object = format!("{{\"a\":{json}}}");
        let tree: Value = serde_json::from_str(&object).expect("it is JSON");
        let carried: Carried = serde_json::from_str(&object).expect("it is JSON");
        prop_assert_eq!(&*carried.0, tree.to_string());
    }
}
