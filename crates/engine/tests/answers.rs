//! Real answers of language models, and how they are parsed.

use swarmbench_engine::answer::{self, Answer, Fault};
use swarmbench_engine::{AgentId, AnswerReader, Config, Control, Settings, TaskName};

/// An answer, and its parsed form as [`shown`] writes it.
type AnswerCase = (&'static str, &'static str);

/// Writes an answer as `UP` for an action, `none` for no action, `: …` for a message, `-> …` for its receiver, or
/// `invalid`.
fn shown(answer: &Answer) -> String {
    let act = &answer.act;
    if !answer.is_valid() {
        assert_eq!((&act.action, &act.message, &act.to), (&None, &None, &None), "{answer:?}");
        return "invalid".to_owned();
    }
    let action = act.action.map_or("none", |action| action.name());
    let message = act.message.as_ref().map(|text| format!(": {text}")).unwrap_or_default();
    let to = act.to.map(|to| format!(" -> {to}")).unwrap_or_default();
    format!("{action}{message}{to}")
}

fn config(task: TaskName, control: Control) -> Config {
    let control = control.name().to_owned();
    Config::check(&Settings { control, ..Settings::standard(task, 1) }).expect("standard settings")
}

fn first_marker(task: TaskName, control: Control) -> Config {
    read_by(AnswerReader::FirstMarker, task, control)
}

fn read_by(reader: AnswerReader, task: TaskName, control: Control) -> Config {
    let [control, answer_reader] = [control.name(), reader.name()];
    let settings = Settings {
        control: control.to_owned(),
        answer_reader: answer_reader.to_owned(),
        ..Settings::standard(task, 1)
    };
    Config::check(&settings).expect("standard settings")
}

fn check(config: &Config, agent: AgentId, rows: &[AnswerCase]) {
    for (text, expected) in rows {
        assert_eq!(shown(&answer::parse(text, config, agent)), *expected, "{text:?}");
    }
}

const ANSWERS: &[AnswerCase] = &[
    // The form that the prompt asks for.
    ("ACTION: UP", "UP"),
    ("ACTION: DOWN\nMSG: hello", "DOWN: hello"),
    ("MSG: hello\nACTION: LEFT", "LEFT: hello"),
    (
        "I see the block.\n\nACTION: RIGHT\nMSG: I push from the left.",
        "RIGHT: I push from the left.",
    ),
    ("ACTION: STAY\n\nThat is my decision.", "STAY"),
    // Upper and lower case, white space, line endings.
    ("action: up", "UP"),
    ("Action: Left\nMsg: Going left", "LEFT: Going left"),
    ("   ACTION:DOWN   ", "DOWN"),
    ("\tACTION:\tRIGHT\n\tMSG:\thi", "RIGHT: hi"),
    ("ACTION : UP", "UP"),
    ("ACTION:    UP     MSG:    hi", "UP: hi"),
    ("ACTION: LEFT\r\nMSG: hi\r\n", "LEFT: hi"),
    ("ACTION: LEFT\rMSG: hi", "LEFT: hi"),
    ("\u{a0}ACTION:\u{a0}UP", "UP"),
    ("MSG: one\ttwo\u{b}three\nACTION: UP", "UP: one two three"),
    // Markdown.
    ("**ACTION:** UP", "UP"),
    ("**ACTION**: UP", "UP"),
    ("**ACTION: UP**\n**MSG: on my way**", "UP: on my way"),
    ("*ACTION: UP*", "UP"),
    ("_ACTION: UP_\n_MSG: hi_", "UP: hi"),
    ("__ACTION:__ UP\n__MSG:__ hi", "UP: hi"),
    ("***ACTION:*** `UP`", "UP"),
    ("`ACTION: UP`", "UP"),
    ("```\nACTION: UP\nMSG: hi\n```", "UP: hi"),
    ("```text\nACTION: UP\n```", "UP"),
    ("~~ACTION: DOWN~~ ACTION: UP", "UP"),
    ("# ACTION: UP", "UP"),
    ("### **ACTION**: UP\n### **MSG**: hi", "UP: hi"),
    ("ACTION: **UP**\nMSG: **hurry**", "UP: hurry"),
    ("ACTION: UP **MSG: hi**", "UP: hi"),
    ("ACTION: UP _MSG: hi_", "UP: hi"),
    // Lists.
    ("- ACTION: UP\n- MSG: hi", "UP: hi"),
    ("* **ACTION:** UP\n* **MSG:** hi", "UP: hi"),
    ("+ ACTION: UP", "UP"),
    ("• ACTION: UP", "UP"),
    ("1. ACTION: UP\n2. MSG: hi", "UP: hi"),
    ("1) ACTION: UP", "UP"),
    ("  - ACTION: UP", "UP"),
    // Quotes and brackets around a value.
    ("ACTION: [UP]\nMSG: [hi there]", "UP: hi there"),
    ("ACTION: \"UP\"\nMSG: \"hi there\"", "UP: hi there"),
    ("ACTION: 'UP'\nMSG: 'hi there'", "UP: hi there"),
    ("ACTION: <UP>\nMSG: <hi there>", "UP: hi there"),
    ("ACTION: (UP)\nMSG: (hi there)", "UP: hi there"),
    ("ACTION: {UP}\nMSG: {hi there}", "UP: hi there"),
    ("ACTION: “UP”\nMSG: “hi there”", "UP: hi there"),
    ("MSG: **\"[hi there]\"**", "none: hi there"),
    ("MSG: 'I'm at (3, 4), don't wait'", "none: I'm at (3, 4), don't wait"),
    // Quotes that are part of the value stay.
    ("MSG: \"left\" or \"right\"", "none: \"left\" or \"right\""),
    ("MSG: 'left' or 'right'", "none: 'left' or 'right'"),
    ("MSG: [3, 4] to [5, 6]", "none: [3, 4] to [5, 6]"),
    ("MSG: (3, 4) is free", "none: (3, 4) is free"),
    ("MSG: prey at (3, 4)", "none: prey at (3, 4)"),
    ("MSG: he said \"up\"", "none: he said \"up\""),
    // The first valid action in the value, as a whole word.
    ("ACTION: move UP", "UP"),
    ("ACTION: UP, then LEFT", "UP"),
    ("ACTION: not sure, LEFT or RIGHT", "LEFT"),
    ("ACTION: UP!", "UP"),
    ("ACTION: UP.", "UP"),
    ("ACTION: UP-LEFT", "UP"),
    ("ACTION: UP/DOWN", "UP"),
    ("ACTION: ⬆️ UP", "UP"),
    ("ACTION: _UP_", "UP"),
    ("ACTION: FLY or STAY", "STAY"),
    ("ACTION: UPWARD", "invalid"),
    ("ACTION: UPWARD or DOWN", "DOWN"),
    ("ACTION: MOVE_UP", "invalid"),
    ("ACTION: UP2", "invalid"),
    ("ACTION: FLY", "invalid"),
    ("ACTION: SWITCH", "invalid"),
    ("ACTION: SWITCH or STAY", "STAY"),
    ("ACTION: 上", "invalid"),
    ("ACTION: ⬆️", "invalid"),
    ("ACTION: none", "invalid"),
    ("ACTION:", "invalid"),
    // The last marker of a kind counts, even if its value is invalid.
    ("ACTION: UP\nACTION: DOWN", "DOWN"),
    ("ACTION: UP ACTION: DOWN", "DOWN"),
    ("ACTION: UP\nACTION: FLY", "invalid"),
    ("ACTION: UP\nACTION:", "invalid"),
    ("ACTION: UP\nMSG: first\nMSG: second", "UP: second"),
    ("ACTION: UP\nMSG: first\nMSG:", "UP"),
    ("ACTION: UP\nMSG: hi\n\nWait, the wall.\n\nACTION: LEFT", "LEFT: hi"),
    // A line holds several markers; a value ends at the next.
    ("ACTION: UP MSG: hi", "UP: hi"),
    ("ACTION: UP, MSG: hi", "UP: hi"),
    ("ACTION: UP; MSG: hi", "UP: hi"),
    ("ACTION: UP | MSG: hi", "UP: hi"),
    ("MSG: hi ACTION: UP", "UP: hi"),
    ("ACTION: UP (stay close) MSG: hi", "UP: hi"),
    ("MSG: I take action: down", "DOWN: I take"),
    ("MSG: my_action: down", "none: my_action: down"),
    ("ACTION: UP MSG: the reaction: none", "UP: the reaction: none"),
    ("ACTION: UP。MSG: 你好", "UP: 你好"),
    // A marker stands at the start of its line.
    ("I choose ACTION: UP", "invalid"),
    ("My action: UP", "invalid"),
    ("Reason, then ACTION: UP\nACTION: LEFT", "LEFT"),
    ("🚀 ACTION: UP", "invalid"),
    ("REACTION: UP", "invalid"),
    ("ACTIONS: UP", "invalid"),
    ("ACTION UP", "invalid"),
    ("ACTION = UP", "invalid"),
    ("ACTION - UP", "invalid"),
    ("UP", "invalid"),
    ("I will move up.", "invalid"),
    ("", "invalid"),
    ("\n\n\n", "invalid"),
    ("{\"ACTION\": \"UP\", \"MSG\": \"hi\"}", "invalid"),
    ("{\n  \"ACTION\": \"UP\",\n  \"MSG\": \"hi\"\n}", "invalid"),
    ("```json\n{\"action\": \"UP\"}\n```", "invalid"),
    ("<action>UP</action>", "invalid"),
    // Thoughts before the answer.
    ("<think>\nACTION: UP would hit the wall.\n</think>\n\nACTION: LEFT\nMSG: hi", "LEFT: hi"),
    ("<think>ACTION: UP or DOWN?</think>\nACTION: DOWN", "DOWN"),
    ("<think>ACTION: UP</think>", "invalid"),
    // Only a message.
    ("MSG: hello", "none: hello"),
    ("ACTION: MSG\nMSG: hello", "none: hello"),
    ("MSG: hello\nACTION: MSG", "none: hello"),
    ("ACTION: MSG: hello", "none: hello"),
    ("**ACTION: MSG:** hello", "none: hello"),
    ("ACTION: **MSG**\nMSG: hello", "none: hello"),
    ("action: msg: hello", "none: hello"),
    ("ACTION: MSG", "invalid"),
    ("ACTION: MSG:", "invalid"),
    ("MSG:", "invalid"),
    ("MSG: \"\"", "invalid"),
    ("MSG: ** **", "invalid"),
    ("ACTION: UP\nMSG:", "UP"),
    ("ACTION: UP\nMSG: \"\"", "UP"),
    ("ACTION: FLY\nMSG: hello", "invalid"),
    ("ACTION:\nMSG: hello", "invalid"),
    ("ACTION: nothing MSG: hello", "invalid"),
    ("ACTION: UP: MSG: hello", "UP: hello"),
    // Other scripts, emoji, texts that look like a receiver.
    ("ACTION: UP\nMSG: 向左走 🚀", "UP: 向左走 🚀"),
    ("ＡＣＴＩＯＮ: UP", "invalid"),
    ("ACTION： UP", "UP"),
    ("MSG: go to: the left", "none: go to: the left"),
    ("ACTION: UP\nTO: Agent_3\nMSG: hi", "UP: hi"),
];

#[test]
fn answers_are_read_by_the_rules() {
    let config = config(TaskName::Transport, Control::Decentralized);
    check(&config, AgentId(3), ANSWERS);
}

#[test]
fn switch_is_an_action_of_synchronization() {
    let config = config(TaskName::Synchronization, Control::Decentralized);
    let rows = [
        ("ACTION: SWITCH", "SWITCH"),
        ("**Action:** switch the light\n**Msg:** on", "SWITCH: on"),
        ("ACTION: SWITCHED", "invalid"),
        ("ACTION: UP", "UP"),
    ];
    check(&config, AgentId(0), &rows);
}

#[test]
fn the_commander_names_a_receiver() {
    let config = config(TaskName::Transport, Control::Centralized);
    let rows = [
        ("ACTION: UP\nTO: Agent_3\nMSG: hi", "UP: hi -> Agent_3"),
        ("MSG: hi TO: Agent_3", "none: hi -> Agent_3"),
        ("TO: Agent_3 MSG: hi", "none: hi -> Agent_3"),
        ("ACTION: MSG TO: Agent_3 MSG: hi", "none: hi -> Agent_3"),
        ("**TO:** `agent_3`\n**MSG:** hi", "none: hi -> Agent_3"),
        ("TO: 3\nMSG: hi", "none: hi -> Agent_3"),
        ("TO: Agent 3\nMSG: hi", "none: hi -> Agent_3"),
        ("TO: [Agent_11].\nMSG: hi", "none: hi -> Agent_11"),
        ("TO: Agent_3\nTO: Agent_4\nMSG: hi", "none: hi -> Agent_4"),
        ("MSG: go to Agent_3", "none: go to Agent_3"),
        ("MSG: a photo: look", "none: a photo: look"),
        // A message that names no possible receiver goes to all.
        ("MSG: hi", "none: hi"),
        ("TO: all\nMSG: hi", "none: hi"),
        ("TO: Agent_0\nMSG: hi", "none: hi"),
        ("TO: Agent_12\nMSG: hi", "none: hi"),
        ("TO: Agent_99999999999999999999\nMSG: hi", "none: hi"),
        ("TO: Agent_3\nTO: all\nMSG: hi", "none: hi"),
        ("TO:\nMSG: hi", "none: hi"),
        ("TO: Agent_3", "invalid"),
        ("ACTION: FLY\nTO: Agent_3\nMSG: hi", "invalid"),
    ];
    check(&config, AgentId::COMMANDER, &rows);
}

#[test]
fn others_write_to_the_commander_whomever_they_name() {
    let config = config(TaskName::Transport, Control::Centralized);
    let rows = [
        ("ACTION: UP\nTO: Agent_3\nMSG: hi", "UP: hi"),
        ("MSG: hi TO: Agent_3", "none: hi"),
        ("MSG: go to: the left", "none: go"),
    ];
    check(&config, AgentId(5), &rows);
}

#[test]
fn the_first_marker_is_found_wherever_its_letters_stand() {
    let rows = [
        ("ACTION: UP", "UP"),
        ("ACTION: UP\nACTION: DOWN", "UP"),
        ("I plan ACTION: LEFT here.\nACTION: RIGHT", "LEFT"),
        ("MY_ACTION: UP", "UP"),
        ("**ACTION:** [DOWN]\n**MSG:** \"go\"", "DOWN: ** \"go\""),
        // An action is found by its letters, in the order of the actions and not of the text.
        ("ACTION: DOWN or UP", "UP"),
        ("ACTION: SUPPORT", "UP"),
        ("ACTION: SWITCH", "SWITCH"),
        ("ACTION: up", "invalid"),
        ("ACTION:\nUP", "invalid"),
        // Three spellings; a later one overrides where it names an action.
        ("Action: UP", "UP"),
        ("action: UP", "UP"),
        ("aCTION: UP", "invalid"),
        ("ACTION : UP", "invalid"),
        ("ACTION：UP", "invalid"),
        ("action: LEFT\nACTION: RIGHT", "LEFT"),
        ("action: nothing\nACTION: RIGHT", "RIGHT"),
        // A message is the text that follows, unchanged; the action need not be one.
        ("MSG: hello", "none: hello"),
        ("ACTION: JUMP\nMSG: hello", "none: hello"),
        ("ACTION: UP MSG: hello", "UP: hello"),
        ("MSG: first\nMSG: second\nACTION: UP", "UP: first"),
        ("MSG: [hello]\r\nACTION: UP", "UP: [hello]"),
        ("msg: small\nMSG: large\nACTION: UP", "UP: small"),
        ("MSG: said\nmsg:\nACTION: UP", "UP"),
        ("MSG: a\rb\nACTION: UP", "UP: a b"),
        ("MSG:", "invalid"),
        ("I think UP is best.", "invalid"),
        ("", "invalid"),
    ];
    let config = first_marker(TaskName::Synchronization, Control::Decentralized);
    check(&config, AgentId(5), &rows);
    let without = first_marker(TaskName::Transport, Control::Decentralized);
    check(
        &without,
        AgentId(5),
        &[("ACTION: SWITCH", "invalid"), ("MSG: hi TO: 3", "none: hi TO: 3")],
    );
    let centralized = first_marker(TaskName::Transport, Control::Centralized);
    let rows = [
        ("ACTION: UP\nMSG: go\nTO: Agent_3\nTO: Agent_4", "UP: go -> Agent_3"),
        ("ACTION: UP\nMSG: go\nTo: 99", "UP: go"),
    ];
    check(&centralized, AgentId::COMMANDER, &rows);
    check(&centralized, AgentId(5), &[("MSG: go\nTO: Agent_3", "none: go")]);
}

#[test]
fn a_long_message_is_cut() {
    let last = config(TaskName::Transport, Control::Decentralized);
    let first = first_marker(TaskName::Transport, Control::Decentralized);
    for (sign, length, cut) in
        [("x", 120, ""), ("x", 121, "..."), ("é", 50_000, "..."), ("🚀", 119, "")]
    {
        let expected = format!("UP: {}{cut}", sign.repeat(length.min(120)));
        for (config, quote) in [(&last, "\""), (&first, "")] {
            let answer = format!("ACTION: UP\nMSG: {quote}{}{quote}", sign.repeat(length));
            assert_eq!(shown(&answer::parse(&answer, config, AgentId(0))), expected);
        }
    }
}

/// Texts that make a reader go back and forth: 200 kB of each would not end if the time were more than linear.
#[test]
fn long_answers_are_read_in_linear_time() {
    let config = config(TaskName::Synchronization, Control::Centralized);
    let first = first_marker(TaskName::Synchronization, Control::Centralized);
    let parts = [
        "ACTION:",
        "MSG:",
        "TO:",
        "ACTION",
        "ACTION ",
        "MSG _",
        "_",
        "_ACTION",
        "*",
        "\"",
        "'",
        "x'y",
        "[",
        "]",
        "[]",
        "(",
        "<",
        "{[(<\"",
        "“",
        "”",
        " ",
        "\t",
        "\r",
        "\n",
        "\r\n",
        "- ",
        "1.",
        "#",
        "ACTION:*",
        "ACTION *",
        "ACTION: MSG: ",
        "agent_",
        "9",
        "你",
        "🚀",
        "\u{2028}",
        "é",
        "ACTION: UP\n",
    ];
    for start in ["", "ACTION: ", "MSG: ["] {
        for part in parts {
            let text = format!("{start}{}\nACTION: SWITCH", part.repeat(200_000 / part.len()));
            let answer = answer::parse(&text, &config, AgentId::COMMANDER);
            assert!(answer.is_valid(), "{start:?}, {part:?}");
            // The first marker may be one without a value.
            let _ = answer::parse(&text, &first, AgentId::COMMANDER);
        }
    }
}

/// Answers by the reader `json`, with their faults.
#[test]
fn the_first_object_of_an_answer_in_json_counts() {
    let rows: &[AnswerCase] = &[
        (r#"{"action": "UP", "message": null}"#, "UP"),
        (r#"{"action": " up ", "message": "hello\nthere"}"#, "UP: hello there"),
        (r#"{"action": null, "message": "wait"}"#, "none: wait"),
        (r#"{"action": "", "message": "wait"}"#, "none: wait"),
        (r#"{"message": "wait"}"#, "none: wait"),
        ("```json\n{\"action\": \"LEFT\"}\n```", "LEFT"),
        (r#"Sure: {"action": "DOWN", "notes": {"a": [1, {"b": 2}]}} {"action": "UP"}"#, "DOWN"),
        (r#"<think>{"action": "UP"}</think> {"action": "DOWN"}"#, "DOWN"),
        (r#"{"action": "UP", "to": "Agent_3", "message": "go"}"#, "UP: go"),
        (r#"{"action": "JUMP", "message": "wait"}"#, "invalid"),
        (r#"{"action": "UP", "action": "DOWN"}"#, "invalid"),
        (r#"{"action": 1, "message": "wait"}"#, "invalid"),
        (r#"{"action": "UP""#, "invalid"),
        (r#"{"action": null, "message": null}"#, "invalid"),
        (r#"["UP", "hello"]"#, "invalid"),
        ("ACTION: UP", "invalid"),
        ("{}", "invalid"),
        ("", "invalid"),
    ];
    let config = read_by(AnswerReader::Json, TaskName::Transport, Control::Decentralized);
    check(&config, AgentId(1), rows);
    for (text, fault) in [
        ("{\"action\": \"JUMP\"}", Fault::UnknownAction),
        ("no object", Fault::NoMarker),
        (" ", Fault::Empty),
    ] {
        assert_eq!(answer::parse(text, &config, AgentId(1)).fault, Some(fault), "{text}");
    }
    let central = read_by(AnswerReader::Json, TaskName::Transport, Control::Centralized);
    let order = r#"{"action": "UP", "message": "go", "to": "Agent_3"}"#;
    check(&central, AgentId::COMMANDER, &[(order, "UP: go -> Agent_3")]);
    check(&central, AgentId(1), &[(order, "UP: go")]);
    // Depth takes neither stack nor time beyond that of the text.
    let deep = "[".repeat(100_000);
    let nested = format!("{{\"notes\": {deep}{}, \"action\": \"UP\"}}", "]".repeat(100_000));
    assert_eq!(shown(&answer::parse(&nested, &config, AgentId(1))), "UP");
    assert_eq!(
        shown(&answer::parse(&format!("{{\"notes\": {deep}"), &config, AgentId(1))),
        "invalid"
    );
    assert_eq!(
        shown(&answer::parse(&format!("{{\"action\": {deep}"), &config, AgentId(1))),
        "invalid"
    );
}
