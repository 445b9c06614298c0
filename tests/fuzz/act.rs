//! `POST /act`: bodies, as far as the barrier.

use bolero::{TypeGenerator, produce};
use serde_json::{Map, Value, json};
use swarmbench::episode::lockstep::Submission;
use swarmbench::http::{read, submission};
use swarmbench_engine::{Action, AgentId, Config, Control, Message, Settings, TaskName, answer};
use swarmbench_journal::record::{ActRecord, RawRecord, Source};
use swarmbench_protocol::act::ActRequest;
use swarmbench_protocol::problem::Problem;
use swarmbench_testkit::check;

/// Possible values of a field of a body.
#[derive(Clone, Debug, TypeGenerator)]
enum Held {
    Left,
    Null,
    Bool(bool),
    Small(u8),
    Number(i64),
    Unsigned(u64),
    Float(f64),
    Text(String),
    Known(#[generator(0..16_u8)] u8),
    Usage { prompt_tokens: u64, latency_ms: Option<u32>, unknown: bool },
    Nested(u8),
}

const KNOWN: [&str; 16] = [
    "UP",
    "SWITCH",
    "up",
    "STAY",
    "Agent_1",
    "Agent_0",
    "Agent_11",
    "Agent_12",
    "Agent_01",
    "hello",
    "ACTION: LEFT\nMSG: hi",
    "TO: 3\nMSG: x",
    "",
    " \r\n\u{2028} ",
    "refusal",
    "no_marker",
];

impl Held {
    fn value(&self) -> Option<Value> {
        Some(match self {
            Self::Left => return None,
            Self::Null => Value::Null,
            Self::Bool(value) => json!(value),
            Self::Small(value) => json!(value),
            Self::Number(value) => json!(value),
            Self::Unsigned(value) => json!(value),
            Self::Float(value) => json!(value),
            Self::Text(value) => json!(value),
            Self::Known(place) => json!(KNOWN[usize::from(*place)]),
            Self::Usage { prompt_tokens, latency_ms, unknown: false } => {
                json!({ "prompt_tokens": prompt_tokens, "latency_ms": latency_ms })
            }
            Self::Usage { .. } => json!({ "speed": 1 }),
            Self::Nested(depth) => {
                (0..*depth).fold(json!([]), |inner, _| Value::Array(vec![inner]))
            }
        })
    }
}

/// A body that is an object, field by field; many are valid.
#[derive(Clone, Debug, TypeGenerator)]
struct Body {
    round: Held,
    good_round: bool,
    /// `Some` for a valid choice between `action` and `response`; `None` for arbitrary fields.
    good: Option<bool>,
    known: u8,
    action: Held,
    response: Held,
    rest: Option<[Held; 5]>,
    unknown: Option<bool>,
}

impl Body {
    fn object(&self) -> Map<String, Value> {
        let known = |texts: &[&str]| Some(json!(texts[usize::from(self.known) % texts.len()]));
        let (action, response) = match self.good {
            Some(true) => (known(&KNOWN[..4]), None),
            Some(false) => (None, self.response.value().or_else(|| known(&KNOWN))),
            None => (self.action.value(), self.response.value()),
        };
        let round = if self.good_round { Some(json!(self.known)) } else { self.round.value() };
        let rest = self.rest.as_ref().map(|rest| rest.each_ref().map(Held::value));
        let [message, to, usage, reasoning, failure] = rest.unwrap_or_default();
        let unknown = self.unknown.filter(|is_there| *is_there).map(|_| json!(1));
        let fields = [
            ("round", round),
            ("action", action),
            ("message", message),
            ("to", to),
            ("response", response),
            ("usage", usage),
            ("reasoning", reasoning),
            ("failure", failure),
            ("speed", unknown),
        ];
        fields.into_iter().filter_map(|(field, value)| Some((field.to_owned(), value?))).collect()
    }
}

/// Passes a body as far as the barrier, like `POST /act`.
fn take(bytes: &[u8], config: &Config, agent: AgentId) -> Result<Submission, Box<Problem>> {
    let request = read::<ActRequest>(bytes).map_err(|error| Box::new(error.problem()))?;
    submission(request, config, agent).map_err(|error| Box::new(error.problem()))
}

/// Checks the properties of every body.
fn check(bytes: &[u8], config: &Config, agent: AgentId) -> Result<Submission, Box<Problem>> {
    let taken = take(bytes, config, agent);
    let value = serde_json::from_slice::<Value>(bytes);
    match &taken {
        Err(problem) => {
            let code = if value.is_ok() { "invalid" } else { "malformed" };
            assert_eq!(problem.code, code, "{problem:?}");
            let is_object = value.is_ok_and(|value| value.is_object());
            assert!(!is_object || !problem.fields.is_empty(), "it names what: {problem:?}");
        }
        Ok(Submission { round, decision }) => {
            let value = value.expect("JSON");
            assert_eq!(value["round"], *round);
            assert_eq!(decision.source, Source::Player);
            assert_ne!(value["action"].is_string(), value["response"].is_string());
            assert!(decision.valid || value["response"].is_string());
            assert_eq!(decision.response.as_deref(), value["response"].as_str());
            assert_eq!(decision.failure.is_some(), !decision.valid);
            assert_eq!(decision.reasoning.as_deref(), value["reasoning"].as_str());
            let act = &decision.act;
            if let Some(response) = &decision.response {
                assert_eq!(answer::parse(response, config, agent).act, *act);
            } else {
                assert_eq!(act.action.map(Action::name), value["action"].as_str());
                assert_eq!(act.message, value["message"].as_str().and_then(Message::new));
            }
            assert!(act.to.is_none_or(|to| to != agent && to.0 < config.num_agents()));
            // The engine knows the decision from its record, and the record reads back as it was written.
            let record = RawRecord::write(&decision.record(agent, 7));
            let read: ActRecord = record.read().expect("a record");
            assert_eq!((read.agent.as_str(), read.bank_spent_ms), (&*agent.to_string(), 7));
            assert_eq!(read.decision(config).as_ref(), Some(decision));
        }
    }
    taken
}

fn configs() -> Vec<Config> {
    let of = |task, control: Control| {
        let control = control.name().to_owned();
        let settings = Settings { control, ..Settings::standard(task, 1) };
        Config::check(&settings).expect("standard settings")
    };
    let tasks = [TaskName::Synchronization, TaskName::Foraging];
    tasks.into_iter().flat_map(|task| Control::ALL.map(|control| of(task, control))).collect()
}

#[test]
fn bodies_are_read_strictly_and_kept_as_they_came() {
    let configs = configs();
    check!(4_000, produce::<(Body, u8, bool, Option<(u16, u8)>)>(), |(
        body,
        setting,
        commands,
        broken,
    )| {
        let config = &configs[usize::from(*setting) % configs.len()];
        let agent = if *commands { AgentId::COMMANDER } else { AgentId(5) };
        let object = body.object();
        let mut bytes = serde_json::to_vec(&object).expect("string keys");
        let taken = check(&bytes, config, agent);

        // A field that is null counts as absent.
        let given = object.clone().into_iter().filter(|(_, value)| !value.is_null());
        let given = Value::Object(given.collect()).to_string();
        let same = check(given.as_bytes(), config, agent);
        let same = same.map_err(|problem| problem.code);
        assert_eq!(same, taken.map_err(|problem| problem.code));

        // An unknown field is refused by its name, unless the whole body is too deep to be read.
        let mut strange = object;
        strange.insert("Round".to_owned(), json!(1));
        let strange = Value::Object(strange).to_string();
        let problem = check(strange.as_bytes(), config, agent).expect_err("unknown");
        let named = problem.fields.first().map(|field| field.field.as_str());
        let is_deep = problem.detail.contains("recursion limit");
        assert_eq!(named, Some("Round").filter(|_| !is_deep), "{problem:?}");

        if let Some((at, byte)) = broken {
            let at = usize::from(*at) % bytes.len();
            bytes[at] = *byte;
            let _ = check(&bytes, config, agent);
            bytes.truncate(at);
            let problem = check(&bytes, config, agent).expect_err("it broke off");
            assert_eq!(problem.code, "malformed");
        }
    });
}

#[test]
fn any_bytes_are_judged() {
    let configs = configs();
    check!(2_000, produce::<Vec<u8>>().with().len(0..4096_usize), |bytes| {
        let _ = check(bytes, &configs[0], AgentId::COMMANDER);
    });
}
