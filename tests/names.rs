//! Names that people read: which are refused, and which look alike.

use swarmbench_protocol::names::{check, check_model, is_look_alike, looks, of_entrant, shown};
use unicode_properties::{GeneralCategory, UnicodeGeneralCategory};

#[test]
fn a_terminal_shows_what_it_would_obey() {
    assert_eq!(shown("a\n\tb é 🐜"), "a\n\tb é 🐜");
    for (text, expected) in [
        ("\u{1b}]0;title\u{7}", "\\u001b]0;title\\u0007"),
        ("a\rb\u{9b}2J\u{7f}", "a\\u000db\\u009b2J\\u007f"),
        ("\u{202e}eulb\u{2066}\u{200f}\u{2028}", "\\u202eeulb\\u2066\\u200f\\u2028"),
        ("a\u{e0041}", "a\\udb40\\udc41"),
    ] {
        assert_eq!(shown(text), expected);
    }
}

#[test]
fn names_have_to_be_seen() {
    for good in [
        "team blue",
        "a",
        "模型",
        "ünïcode 🐜",
        "gpt-4 (2026)",
        "ㅎ한글",
        "⠓⠊",
        "हिन्दी",
        "ខ្មែរ",
        "ภาษาไทย",
        "שָׁלוֹם",
        "العَرَبِيَّة",
        "か\u{3099}",
        "п\u{301}",
        "\u{18b00}\u{16fe4}\u{18b01}",
    ] {
        assert_eq!(check(good, 20), Ok(()), "{good:?}");
    }
    for hidden in [
        " ",
        "\u{a0}",
        "\u{3164}",
        "blue\u{3164}",
        "\u{ffa0}",
        "\u{115f}\u{1160}",
        "a\u{200b}",
        "\u{2800}",
        "a\u{fe0f}",
        "a\u{e0101}",
        "\u{ad}",
        "a\u{34f}",
        "\u{17b4}",
        "\u{202e}eulb",
        "\u{e000}",
        "\u{feff}",
        "a\u{2028}",
        "zoo\u{1d159} x",
        "blue\u{fffc}",
        "ab\u{13441}\u{13442}",
        "ki\u{16fe4}t",
        "\u{16fe4}",
        "ki\u{2d7f}t",
        "ki\u{1bc9d}t",
        "k\u{17d2}it",
    ] {
        let problem = check(hidden, 20).expect_err(hidden);
        assert!(problem.contains("must be seen"), "{hidden:?}: {problem}");
    }
    for wrong in ["", "a\u{7}", "a name of more than twenty characters"] {
        assert!(check(wrong, 20).expect_err(wrong).contains("1 to 20"), "{wrong:?}");
    }
}

#[test]
fn only_built_in_players_look_like_those() {
    for good in ["built-in/random", "builtin", "my built-in/model", "random"] {
        assert_eq!(check_model(good, 50), Ok(()), "{good:?}");
    }
    for alike in [
        "Built-in/random",
        "bui\u{1c0}t-in/random",
        "built-\u{456}n/random",
        " built-in/random",
        "buiIt-in/random",
    ] {
        assert!(check_model(alike, 50).expect_err(alike).contains("looks like"), "{alike:?}");
    }
}

#[test]
fn names_that_look_the_same_are_found() {
    for (one, other) in [
        ("blue", " BLUE"),
        ("blue", "blu\u{435}"),
        ("l1", "Il"),
        ("Team Rocket", "team \u{3000}\u{a0}Rocket "),
        ("Straße", "STRASSE"),
        ("ΣΟΦΟΣ", "σοφος"),
        // Case and look-alikes in one name.
        ("Mallory Il", "mallory ll"),
        ("Kim Il", "kiM ll"),
        ("Ilm", "IIM"),
        ("IIM", "llrn"),
        ("Team 1", "TEAM i"),
        ("TEAM |", "team l"),
        ("N0M", "norn"),
        ("\u{3bd}icky \u{39d}orth", "VICKY NORTH"),
        ("HOP\u{414}", "\u{43d}\u{43e}\u{440}\u{434}"),
        ("МОСКВА", "MOCKBA"),
        ("mockba", "МОСКВА"),
        // Dots that a letter has anyway.
        ("bird", "bi\u{307}rd"),
        ("tim", "t\u{130}m"),
        ("tim", "TI\u{307}M"),
        ("jojo", "j\u{307}oj\u{307}o"),
        ("l\u{328}nes", "\u{12f}\u{307}nes"),
        // Other forms of letters.
        ("Organic", "\u{24c4}rganic"),
        ("kit", "\u{1d4c0}\u{1d4be}\u{1d4c9}"),
        ("kit", "\u{ff2b}\u{ff29}\u{ff34}"),
        ("Fire", "\u{fb01}re"),
        ("kit", "\u{1f15a}\u{1f178}\u{1f1f9}"),
        ("team", "\u{1d1b}\u{1d07}\u{1d00}\u{1d0d}"),
        // Pairs of letters that look like one.
        ("Wolf", "vvolf"),
        ("wolf", "VVolf"),
        ("dub", "club"),
        ("dub", "cIub"),
        ("CLUB", "c1ub"),
        ("modern", "rnoclem"),
        ("vWest", "Wvest"),
        ("a_b", "a\u{2017}b"),
    ] {
        assert!(is_look_alike(one, other), "{one:?} {other:?}");
    }
    for c in ' '..='~' {
        let [small, written] = looks(&c.to_string());
        assert_eq!(small.strip_prefix("small "), written.strip_prefix("written "), "{c:?}");
        let [upper, lower] = [c.to_ascii_uppercase(), c.to_ascii_lowercase()];
        assert_eq!(looks(&upper.to_string()), looks(&lower.to_string()), "{c:?}");
    }
    let longest = looks(&"\u{fdfa}".repeat(200));
    assert!(longest.iter().all(|look| look.chars().count() < 2 * 200 + 10), "{longest:?}");
    let is_dash = |c: &char| c.general_category() == GeneralCategory::DashPunctuation;
    for dash in (' '..=char::MAX).filter(is_dash).chain(['\u{2212}']) {
        assert!(is_look_alike("gpt-5", &format!("GPT{dash}5")), "{dash:?}");
    }
    for (one, other) in [
        ("blue", "red"),
        // White space is compared: only its kind and length are not.
        ("Team Rocket", "TeamRocket"),
        ("Foo Bar", "Foo - Bar"),
        ("Foo Bar", "Foo-Bar"),
        ("Illinois", "Illinoise"),
        ("Team 1", "Team 2"),
        ("Team 5", "Team S"),
        ("Team A", "Team 4"),
        ("Żaba", "Zaba"),
        ("Muller", "Müller"),
        ("naïve", "naive"),
        ("12 אב", "אב 12"),
        ("Вова", "Нона"),
        ("ΝΙΚΟΣ", "ΝΕΚΟΣ"),
    ] {
        assert!(!is_look_alike(one, other), "{one:?} {other:?}");
    }
}

#[test]
fn no_entrant_is_called_like_somebody_else() {
    let named = |name: &str| of_entrant(name, 50, ["close-in", "random", "step-3"]);
    for (name, shown) in [
        (" Team \u{a0} Rocket", "Team Rocket"),
        ("Entropy", "Entropy"),
        ("server room", "server room"),
        ("randomness", "randomness"),
        ("Server 5", "Server 5"),
        ("Judge 1", "Judge 1"),
        ("Illinois", "Illinois"),
        ("Eras Education", "Eras Education"),
        ("Ent-wood", "Ent-wood"),
        ("Keystone", "Keystone"),
        ("The Entropy", "The Entropy"),
        ("Theory of Judges", "Theory of Judges"),
        ("Team organizer", "Team organizer"),
        ("my built-in/x", "my built-in/x"),
    ] {
        assert_eq!(named(name).as_deref(), Ok(shown));
    }
    for (name, reserved) in [
        ("organizer", "organizer"),
        ("Organisers", "organiser"),
        ("0rganizer", "organizer"),
        ("[ Judge ]", "judge"),
        ("\u{405}ERVER", "server"),
        ("swarm-bench", "swarmbench"),
        ("erased ent_01", "erased"),
        ("ENT_0198", "ent_"),
        ("built\u{2014}in/random", "built-in/"),
        ("Close In", "close-in"),
        ("RANDOM", "random"),
        ("Step 3", "step-3"),
        ("0rgan1zer", "organizer"),
        ("adm1n", "admin"),
        ("AdmIn", "admin"),
        ("@dmin", "admin"),
        ("5erver", "server"),
        ("$3rv3r", "server"),
        ("5t4ff", "staff"),
        ("\u{24de}\u{24e1}\u{24d6}\u{24d0}\u{24dd}\u{24d8}\u{24e9}\u{24d4}\u{24e1}", "organizer"),
        ("\u{24c4}rganizer", "organizer"),
        ("\u{1f15e}rganizer", "organizer"),
        ("adm\u{131}\u{307}n", "admin"),
        ("the organizer", "organizer"),
        ("The 5ervers!", "server"),
        ("(erased)", "erased"),
        ("\"erased\"", "erased"),
        (".erased", "erased"),
        ("[built-in/x]", "built-in/"),
        ("ent\u{2017}x", "ent_"),
        ("ent\u{203f}x", "ent_"),
        ("_key_x", "key_"),
    ] {
        let problem = named(name).expect_err(name);
        assert!(problem.contains(&format!("{reserved:?}")), "{name:?}: {problem}");
    }
    assert!(named("\u{7}").is_err() && named("").is_err());
}
