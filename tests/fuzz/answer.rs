//! The reader of language models' answers (rules: *Answers of language models*).

use bolero::{TypeGenerator, produce};
use swarmbench_engine::answer::{self, Answer};
use swarmbench_engine::{
    Act, Action, AgentId, AnswerReader, Config, Control, Message, Settings, TaskName,
};

use swarmbench_testkit::check;

/// Pieces of text that make a difference to the reader.
const PIECES: [&str; 47] = [
    "\nACTION: ",
    "\nACTION: UP",
    "\naction: ",
    "\nMSG: ",
    "\nMSG: hello",
    "\nTO: ",
    "\nTO: Agent_3",
    "ACTION",
    "MSG",
    "TO",
    "ACTION:",
    "MSG:",
    "to:",
    ":",
    "：",
    "UP",
    "down",
    "Left",
    "SWITCH",
    "STAY",
    "MSG",
    "agent 4",
    "0",
    "99999",
    "\n",
    "\r",
    "\r\n",
    "\u{2028}",
    "\t",
    " ",
    "*",
    "_",
    "`",
    "~",
    "- ",
    "1. ",
    "#",
    "\"",
    "'",
    "[",
    "]",
    "(",
    ")",
    "“",
    "”",
    "don't",
    "e\u{301}🐜",
];

/// A part of an answer.
#[derive(Clone, Debug, TypeGenerator)]
enum Part {
    Marker(#[generator(0..7_u8)] u8),
    Piece(#[generator(0..47_u8)] u8),
    Other(#[generator(7..47_u8)] u8),
    Char(char),
}

fn text(parts: &[Part]) -> String {
    let part = |part: &Part| match part {
        Part::Marker(piece) | Part::Piece(piece) | Part::Other(piece) => {
            PIECES[usize::from(*piece)].to_owned()
        }
        Part::Char(c) => c.to_string(),
    };
    parts.iter().map(part).collect()
}

fn config(task: TaskName, control: Control, reader: AnswerReader) -> Config {
    let (control, answer_reader) = (control.name().to_owned(), reader.name().to_owned());
    let settings = Settings { control, answer_reader, ..Settings::standard(task, 1) };
    Config::check(&settings).expect("standard settings")
}

/// Rules for every answer.
fn check(text: &str, config: &Config, agent: AgentId) -> Answer {
    let answer = answer::parse(text, config, agent);
    let (act, valid) = (&answer.act, answer.is_valid());
    assert_eq!(valid, act.action.is_some() || act.message.is_some());
    assert!(valid || *act == Act::default(), "an invalid answer does nothing");
    assert!(act.action.is_none_or(|action| Action::of_task(config.task()).contains(&action)));
    if let Some(message) = &act.message {
        let chars = message.as_str().chars().count();
        assert!(chars <= 120 || (chars == 123 && message.as_str().ends_with("...")), "{chars}");
        assert_eq!(Message::new(message.as_str()).as_ref(), Some(message), "it is one already");
    }
    if let Some(to) = act.to {
        assert!(config.control() == Control::Centralized && agent == AgentId::COMMANDER);
        assert!(to != agent && to.0 < config.num_agents());
    }
    answer
}

#[test]
fn answers_are_read_by_the_rules() {
    let configs: Vec<Config> = [TaskName::Synchronization, TaskName::Transport]
        .into_iter()
        .flat_map(|task| {
            Control::ALL.map(|control| config(task, control, AnswerReader::LastMarker))
        })
        .collect();
    check!(4_000, produce::<(Vec<Part>, String, u8, bool)>(), |(
        parts,
        prose,
        setting,
        commands,
    )| {
        let config = &configs[usize::from(*setting) % configs.len()];
        let agent = if *commands { AgentId::COMMANDER } else { AgentId(5) };
        let text = text(parts);
        let read = check(&text, config, agent);

        // A line without a colon has no marker, so prose around the answer changes nothing.
        let prose = prose.replace([':', '：'], " ");
        let around = check(&format!("{prose}\n{text}\r{prose}"), config, agent);
        // But that an answer with prose is not empty.
        assert_eq!((&around.act, around.is_valid()), (&read.act, read.is_valid()));

        // All line ends are the same.
        let lines = text.replace("\r\n", "\n");
        assert_eq!(check(&lines.replace('\n', "\r\n"), config, agent), read);
        assert_eq!(check(&lines.replace('\n', "\r"), config, agent), read);

        // Markers, actions and receivers are read in any case.
        let mut lower = read.clone();
        let message = read.act.message.map(|message| message.as_str().to_ascii_lowercase());
        lower.act.message = message.as_deref().and_then(Message::new);
        assert_eq!(check(&text.to_ascii_lowercase(), config, agent), lower);

        // The last marker of a kind counts, whatever came before.
        let last = check(&format!("{text}\nACTION: DOWN\nMSG: \"so be it\""), config, agent);
        assert!(last.is_valid());
        assert_eq!(last.act.action, Some(Action::Down));
        assert_eq!(last.act.message, Message::new("so be it"));
        assert!(read.act.to.is_none() || last.act.to == read.act.to);
        assert!(!check(&format!("{text}\nACTION: nothing\nMSG:"), config, agent).is_valid());

        // Who answers matters for the receiver alone.
        let other = check(&text, config, AgentId(6));
        assert_eq!((other.is_valid(), other.act.action), (lower.is_valid(), lower.act.action));
    });
}

#[test]
fn any_bytes_are_read() {
    let configs = AnswerReader::ALL
        .map(|reader| config(TaskName::Synchronization, Control::Centralized, reader));
    check!(2_000, produce::<Vec<u8>>().with().len(0..4096_usize), |bytes| {
        for config in &configs {
            check(&String::from_utf8_lossy(bytes), config, AgentId::COMMANDER);
        }
    });
}

/// The first place of a marker decides, whatever follows on later lines.
#[test]
fn the_first_marker_is_read_by_the_rules() {
    let config =
        config(TaskName::Synchronization, Control::Decentralized, AnswerReader::FirstMarker);
    check!(4_000, produce::<(Vec<Part>, String)>(), |(parts, prose)| {
        let text = text(parts);
        check(&text, &config, AgentId(5));
        let prose = prose.replace([':', '\n'], " ");
        let own = format!("{prose}\naction: DOWN\nmsg: so be it\n{text}");
        let read = check(&own, &config, AgentId(5));
        assert_eq!(read.act.action, Some(Action::Down));
        assert_eq!(read.act.message, Message::new("so be it"));
    });
}
