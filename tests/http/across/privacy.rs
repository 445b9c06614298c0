//! Answers to an agent depend on nothing that it may not know.
//!
//! Two episodes of the same settings are played alike for some rounds. Then agents do hidden things differently
//! in the second: they move out of sight, say something to others, switch lights that are far away; and
//! everybody gives other reasons, costs and words of a language model. An oracle, written from the rules alone,
//! says which agents may know of none of that. What those are sent must be the same to the byte.
//!
//! `SWARMBENCH_PRIVACY_CASES=5000` plays more pairs, `SWARMBENCH_PRIVACY_SEED=17` begins at that seed.

use std::ops::Range;

use futures::stream::{self, StreamExt};
use serde::Deserialize;
use serde_json::value::RawValue;
use serde_json::{Value, json};
use swarmbench_testkit::oracle::{self, Blind, Body, OracleGame, PlannedAct, State};
use swarmbench_testkit::worlds::Dice;

use crate::app::mcp::observed;
use crate::app::{Episode, TestApp, list};

/// The default number of pairs.
const CASES: u64 = 200;

/// A game as it is played on a server.
struct Played {
    episode: Episode,
    /// The seat holders: the last of them, and the token for all. Every third game has several holders.
    holders: Vec<(usize, String)>,
    /// The tokens of all seats, whosever they are.
    seats: Vec<String>,
    game: OracleGame,
    receipts: Vec<String>,
}

#[derive(Deserialize)]
struct Many<'a> {
    #[serde(borrow)]
    observations: Vec<&'a RawValue>,
    finished: bool,
}

#[derive(Deserialize)]
struct Receipts<'a> {
    #[serde(borrow)]
    receipts: Vec<&'a RawValue>,
}

impl Played {
    async fn new(app: &TestApp, seed: u64, dice: &mut Dice) -> [Self; 2] {
        let settings = oracle::settings(dice);
        let request = json!({
            "task": settings.task, "rules": settings.rules, "control": settings.control,
            "seed": settings.seed, "num_agents": settings.num_agents, "width": settings.width,
            "height": settings.height, "view_size": settings.view_size, "memory": settings.memory,
            "max_round": settings.max_round, "noise": settings.noise, "max_delay": settings.max_delay,
        });
        let game = OracleGame { settings, states: Vec::new(), planned: Vec::new() };
        let mut claims = Vec::new();
        // Who holds what is drawn apart: the games of a seed are the same for all players.
        let mut dice = Dice(!seed);
        if dice.below(3) == 0 {
            let agents = usize::try_from(game.settings.num_agents).expect("a few");
            let mut open = dice.below(agents + 1);
            while open > 0 {
                claims.push(1 + dice.below(open));
                open -= claims[claims.len() - 1];
            }
        }
        let one = Self::create(app, request.clone(), &claims, game.clone()).await;
        [one, Self::create(app, request, &claims, game).await]
    }

    /// Creates an episode with open seats, which others claim one after the other.
    async fn create(app: &TestApp, mut request: Value, claims: &[usize], game: OracleGame) -> Self {
        request["open_seats"] = json!(claims.iter().sum::<usize>());
        let episode = app.create(request).await;
        let mut seats: Vec<String> = episode.seats().map(str::to_owned).collect();
        let mut holders = vec![(seats.len(), episode.swarm.clone())];
        for count in claims {
            let claim =
                app.post(&episode.path("/claims")).json(&json!({ "seats": count })).ok().await;
            let text = |value: &Value| value.as_str().expect("a text").to_owned();
            seats.extend(list(&claim["seats"]).iter().map(|seat| text(&seat["token"])));
            holders.push((seats.len(), text(&claim["swarm_token"])));
        }
        let mut played = Self { episode, holders, seats, game, receipts: Vec::new() };
        played.look(app).await;
        played
    }

    /// The holders, each with a token and its agents of these.
    fn by_holder(&self, agents: &[usize]) -> Vec<(&str, Vec<usize>)> {
        let mut first = 0;
        let mut all = Vec::with_capacity(self.holders.len());
        for (end, token) in &self.holders {
            let own = agents.iter().copied().filter(|agent| (first..*end).contains(agent));
            all.push((token.as_str(), own.collect()));
            first = *end;
        }
        all
    }

    /// Notes the state as a spectator sees it.
    async fn look(&mut self, app: &TestApp) {
        let shown = app.state(&self.episode).await;
        let row = |row: &Value| row.as_str().expect("a row").chars().collect();
        let body = |agent: &Value| Body {
            at: (agent["i"].as_i64().expect("a row"), agent["j"].as_i64().expect("a column")),
            alive: agent["alive"] == true,
            flag: agent["light_on"] == true || agent["carrying_food"] == true,
        };
        self.game.states.push(State {
            score: shown["score"].as_f64().expect("a score"),
            grid: list(&shown["grid"]).iter().map(row).collect(),
            agents: list(&shown["agents"]).iter().map(body).collect(),
        });
    }

    /// Plays a round; how the acts are worded, and what they cost, is drawn from `words`.
    async fn step(&mut self, app: &TestApp, planned: Vec<PlannedAct>, words: &mut Dice) {
        let round = self.game.planned.len();
        let acts: Vec<Value> = (self.alive(round).into_iter())
            .map(|agent| {
                let mut act = worded(&planned[agent], words);
                act["episode"] = json!(self.episode.id);
                act["agent"] = json!(format!("Agent_{agent}"));
                act["round"] = json!(round);
                act
            })
            .collect();
        let mut acts = acts.into_iter();
        let mut receipts = Vec::new();
        for (token, own) in self.by_holder(&self.alive(round)) {
            let acts: Vec<Value> = acts.by_ref().take(own.len()).collect();
            let call = app.post("/swarm/act").token(token).json(&json!({ "acts": acts }));
            let text = call.send().await.text();
            let answer: Receipts<'_> = serde_json::from_str(&text).expect("receipts");
            receipts.extend(answer.receipts.iter().map(|receipt| self.anonymous(receipt.get())));
        }
        self.receipts = receipts;
        self.game.planned.push(planned);
        self.look(app).await;
    }

    /// The agents that are on the map when a round is decided.
    fn alive(&self, round: usize) -> Vec<usize> {
        let agents = self.game.states[round].agents.iter().enumerate();
        agents.filter(|(_, body)| body.alive).map(|(agent, _)| agent).collect()
    }

    /// Answers to each agent now, to the byte; the escaped ask for themselves. Nothing once the episode has
    /// ended: its result names a head, which stands for everything.
    async fn sent(&self, app: &TestApp) -> Option<Vec<String>> {
        let mut sent = vec![String::new(); self.game.state().agents.len()];
        for (token, living) in self.by_holder(&self.alive(self.game.planned.len())) {
            let call = app.get("/swarm/obs?prompt=true&limit=1024").token(token);
            let text = call.send().await.text();
            let many: Many<'_> =
                serde_json::from_str(&text).unwrap_or_else(|error| panic!("{error}: {text}"));
            if many.finished {
                return None;
            }
            // Nobody is sent what another's agent sees.
            assert_eq!(many.observations.len(), living.len(), "{text}");
            for (agent, seen) in living.into_iter().zip(many.observations) {
                sent[agent] = self.anonymous(seen.get());
            }
        }
        for (agent, seen) in sent.iter_mut().enumerate() {
            if seen.is_empty() {
                *seen = self.obs(app, agent).await;
            }
        }
        Some(sent)
    }

    /// Observation of one agent by its own token.
    async fn obs(&self, app: &TestApp, agent: usize) -> String {
        let call = app.get("/obs?prompt=true").token(&self.seats[agent]);
        self.anonymous(&call.send().await.text())
    }

    /// Observation of one agent by the tool of its seat.
    async fn look_by_tool(&self, app: &TestApp, agent: usize) -> Value {
        let looked = app.tool(&self.seats[agent], "look", json!({})).await;
        serde_json::from_str(&self.anonymous(&looked.to_string())).expect("JSON")
    }

    /// The same text for both episodes, but for what differs.
    fn anonymous(&self, text: &str) -> String {
        text.replace(&self.episode.id, "ep_")
    }
}

/// An act, as an action or as the answer of a language model, with what nobody else is to know.
fn worded(planned: &PlannedAct, words: &mut Dice) -> Value {
    let mut act = if words.below(2) == 0 || planned.to.is_some() {
        json!({ "action": planned.action, "message": planned.message })
    } else {
        let message = planned.message.as_ref().map(|text| format!("\n**MSG:** \"{text}\""));
        let thought = words.below(1_000);
        let response =
            format!("I saw {thought}.\nACTION: {}{}", planned.action, message.unwrap_or_default());
        json!({ "response": response })
    };
    if let Some(to) = planned.to {
        act["to"] = json!(format!("Agent_{to}"));
    }
    if words.below(2) == 0 {
        act["reasoning"] = json!(format!("reason {}", words.below(1_000)));
        act["usage"] =
            json!({ "prompt_tokens": words.below(1_000), "latency_ms": words.below(1_000) });
    }
    act
}

/// Comparisons of two agents that were to be sent the same, and the result.
#[derive(Debug, Default)]
struct Count {
    alike: u32,
    /// Comparisons in episodes in which something differed: at that moment, and ever.
    hidden: [u32; 2],
    differ: u32,
}

impl std::ops::AddAssign for Count {
    fn add_assign(&mut self, other: Self) {
        self.alike += other.alike;
        self.hidden[0] += other.hidden[0];
        self.hidden[1] += other.hidden[1];
        self.differ += other.differ;
    }
}

/// Plays pairs of episodes, many at once, and compares what is sent to agents that the oracle cannot tell apart.
async fn compare(app: &TestApp, seeds: Range<u64>, blind: Blind) -> Count {
    let mut all = Count::default();
    let mut pairs =
        stream::iter(seeds).map(|seed| compare_pair(app, seed, blind)).buffer_unordered(16);
    while let Some(count) = pairs.next().await {
        all += count;
    }
    all
}

async fn compare_pair(app: &TestApp, seed: u64, blind: Blind) -> Count {
    let mut count = Count::default();
    let mut dice = Dice(seed);
    let [mut one, mut other] = Played::new(app, seed, &mut dice).await;
    let alike = dice.below(4);
    let observer = dice.below(one.game.state().agents.len());
    for round in 0..alike + 1 + dice.below(4) {
        let is_alike = round < alike;
        let planned = oracle::planned(&mut dice, &one.game);
        let changed = oracle::changed(&mut dice, &one.game, &planned, observer);
        let [mut words, mut others] =
            [1, 2].map(|stream| Dice(seed << 8 | stream << 4 | round as u64));
        other.step(app, if is_alike { planned.clone() } else { changed }, &mut others).await;
        one.step(app, planned, &mut words).await;
        if is_alike {
            // Nothing is compared yet, and both games end alike.
            if app.show(&one.episode).await["status"] != "running" {
                break;
            }
            continue;
        }
        let (Some(mine), Some(theirs)) = (one.sent(app).await, other.sent(app).await) else {
            break;
        };
        compare_round(app, seed, [(&one, &mine), (&other, &theirs)], blind, &mut count).await;
    }
    count
}

async fn compare_round(
    app: &TestApp,
    seed: u64,
    [(one, mine), (other, theirs)]: [(&Played, &[String]); 2],
    blind: Blind,
    count: &mut Count,
) {
    for (agent, (mine, theirs)) in mine.iter().zip(theirs).enumerate() {
        if one.game.knowledge(agent, blind) != other.game.knowledge(agent, blind) {
            continue;
        }
        let differs = mine != theirs;
        assert!(
            !differs || blind != Blind::Nothing,
            "SWARMBENCH_PRIVACY_SEED={seed}: Agent_{agent} is sent\n{mine}\nand\n{theirs}"
        );
        count.alike += 1;
        for (count, differs) in count.hidden.iter_mut().zip(one.game.differs_from(&other.game)) {
            *count += u32::from(differs);
        }
        count.differ += u32::from(differs);
    }
    if blind != Blind::Nothing {
        return;
    }
    // One agent also asks for itself: it is sent the same as by the swarm's token.
    let agent = one.game.planned.len() % mine.len();
    for (played, sent) in [(one, mine), (other, theirs)] {
        assert_eq!(played.obs(app, agent).await, sent[agent], "SWARMBENCH_PRIVACY_SEED={seed}");
    }
    // And over `/mcp`.
    let [looked, others] =
        [one.look_by_tool(app, agent).await, other.look_by_tool(app, agent).await];
    for (looked, sent) in [(&looked, mine), (&others, theirs)] {
        let seen: Value = serde_json::from_str(&sent[agent]).expect("JSON");
        assert_eq!(observed(looked), seen, "SWARMBENCH_PRIVACY_SEED={seed}");
    }
    assert_eq!(looked == others, mine[agent] == theirs[agent], "SWARMBENCH_PRIVACY_SEED={seed}");
    // A receipt says what the agent did itself, and for how many of the living the round still waited.
    let round = one.game.planned.len() - 1;
    let [alive, theirs] = [one, other].map(|played| played.alive(round));
    if alive == theirs {
        for (place, agent) in alive.into_iter().enumerate() {
            let did = |played: &Played| {
                let PlannedAct { action, message, .. } = &played.game.planned[round][agent];
                (*action, message.clone())
            };
            let is_same = one.receipts[place] == other.receipts[place];
            assert_eq!(is_same, did(one) == did(other), "SWARMBENCH_PRIVACY_SEED={seed}: {agent}");
        }
    }
}

/// A number from the environment.
fn asked(name: &str) -> Option<u64> {
    let text = std::env::var(name).ok()?;
    Some(text.parse().unwrap_or_else(|_| panic!("{name} must be a number, is {text:?}")))
}

#[tokio::test]
async fn nobody_is_sent_what_it_may_not_know() {
    let app = TestApp::start().await;
    let (first, cases) = (asked("SWARMBENCH_PRIVACY_SEED"), asked("SWARMBENCH_PRIVACY_CASES"));
    let (first, cases) = (first.unwrap_or(0), cases.unwrap_or(CASES));
    let count = compare(&app, first..first + cases, Blind::Nothing).await;
    println!("{cases} pairs: {count:?}");
    // There was something to hide, often enough.
    if cases >= CASES {
        assert!(u64::from(count.alike) > 4 * cases, "{count:?}");
        let [now, ever] = count.hidden;
        assert!(now > count.alike / 4 && ever > count.alike / 2, "{count:?}");
    }
}

/// Without this, a comparison that never finds anything would look the same. Each thing that an oracle can overlook is
/// tested without a server, in `crates/engine/tests/privacy`.
#[tokio::test]
async fn an_oracle_that_overlooks_something_is_found_out() {
    let app = TestApp::start().await;
    for first in (0..1_000).step_by(16) {
        if compare(&app, first..first + 16, Blind::Messages).await.differ > 0 {
            return;
        }
    }
    panic!("an oracle that overlooks messages was not found out");
}
