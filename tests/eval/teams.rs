//! Teams: several players on the seats of one swarm.

use std::path::Path;

use rustix::process::Signal;
use serde_json::Value;
use swarmbench_client::eval::experiment::Experiment;
use swarmbench_client::eval::plan::{Plan, PlanError, Planned, RUNS_MAX, Who, no_prices};

use super::bench::Bench;
use crate::llm::endpoint::{Endpoint, Reply};

/// Two seeds, three rounds, four agents: `strong` has two of them.
fn file(strong: &Endpoint, weak: &Endpoint) -> String {
    format!(
        "tasks = 'Synchronization'\nseeds = [1, 2]\n[settings]\nnum_agents = 4\nmax_round = 3\n\
         [[models]]\nname = 'strong'\napi_base = '{}'\nsystem = 'be strong'\n\
         [[models]]\nname = 'weak'\napi_base = '{}'\ntemperature = 0.5\nmax_tokens = 50\n\
         [[teams]]\nname = 'both'\nmembers = [{{ model = 'strong', seats = '0..2' }}, {{ model = 'weak', seats = 2 }}, \
         {{ player = 'random', seats = 3 }}]\n",
        strong.base(),
        weak.base()
    )
}

/// Questions to `strong` and to `weak`.
const ASKED: (usize, usize) = (2 * 3 * 2, 2 * 3);

async fn says(answer: &'static str) -> Endpoint {
    Endpoint::start(move |_, _| Reply::says(answer)).await
}

/// Answers so often, and then leaves everybody waiting.
async fn answers(count: usize, answer: &'static str) -> Endpoint {
    Endpoint::start(move |number, _| {
        let reply = Reply::says(answer);
        if number < count { reply } else { reply.held_until(1) }
    })
    .await
}

fn agent(prompt: &str) -> Option<&str> {
    prompt.split_whitespace().find(|word| word.starts_with("Agent_")).map(|word| &word[..7])
}

#[tokio::test]
async fn each_model_is_asked_for_its_own_seats_in_its_own_way() {
    let bench = Bench::new();
    let (strong, weak) = (says("ACTION: STAY").await, says("ACTION: SWITCH").await);
    bench.write("both.toml", &file(&strong, &weak));
    let dry = bench.eval(&["both.toml", "--dry-run", "--format", "json"]).await.ends(0);
    let dry: Value = serde_json::from_str(&dry.out).expect("JSON");
    assert_eq!(dry["runs"].as_array().map(Vec::len), Some(1), "models of teams do not play alone");
    assert_eq!(dry["runs"][0]["asked_max"], ASKED.0 + ASKED.1);
    let done = bench.eval(&["both.toml", "--verify", "--format", "json"]).await.ends(0);
    let board: Value = serde_json::from_str(&done.out).expect("JSON");
    let row = &board["rows"][0];
    assert_eq!((row["model"].as_str(), row["verified"].as_bool()), (Some("both"), Some(true)));
    assert_eq!(row["acts"]["prompt_tokens"], 10 * (ASKED.0 + ASKED.1));
    let prompt = row["prompt"].as_str().expect("a name");
    assert!(prompt.starts_with("strong: default+system:"), "{prompt}");
    assert!(prompt.ends_with("; weak: default"), "{prompt}");
    // The team has no temperature, as `strong` has none.
    assert_eq!(row["sampling"], "weak: max_tokens 50, temperature 0.5");
    for (endpoint, count, seats) in
        [(&strong, ASKED.0, &["Agent_0", "Agent_1"][..]), (&weak, ASKED.1, &["Agent_2"])]
    {
        let seen = endpoint.seen();
        assert_eq!(seen.len(), count);
        for asked in seen {
            let messages = asked.body["messages"].as_array().expect("messages");
            let prompt = messages.last().expect("one")["content"].as_str().expect("a prompt");
            assert!(seats.contains(&agent(prompt).expect("a name")), "{prompt}");
            let is_strong = messages.len() == 2 && messages[0]["content"] == "be strong";
            assert_eq!(is_strong, asked.body["temperature"] != 0.5);
            assert_eq!(is_strong, count == ASKED.0);
        }
    }
    // The same again: nothing is asked.
    bench.eval(&["both.toml"]).await.ends(0).says(&["was played before"]);
    assert_eq!((strong.seen().len(), weak.seen().len()), ASKED);
    let serving = bench.serve().await;
    let board: Value = serving
        .client
        .get_with("/api/v1/leaderboard", &[("suite", &*serving.run().await.run.suite.name)])
        .await
        .expect("a board");
    let row = &board["items"][0];
    assert_eq!((&row["kind"], &row["decentralization"]), (&"team".into(), &"enforced".into()));
    let prompts: Vec<_> = row["holders"].as_array().expect("holders").iter().collect();
    assert!(prompts[0]["prompt"].as_str().expect("a prompt").starts_with("default+system:"));
    assert_eq!((&prompts[1]["prompt"], &prompts[2]["prompt"]), (&"default".into(), &Value::Null));
    serving.stop().await;
}

/// Program and server are killed in the middle of a round, twice.
#[tokio::test]
async fn a_team_resumes_after_a_kill() {
    let bench = Bench::new();
    let mut before = 0;
    for answered in [3, 2] {
        let (strong, weak) =
            (answers(answered, "ACTION: STAY before").await, says("ACTION: STAY").await);
        bench.write("both.toml", &file(&strong, &weak));
        let running = bench.start(&["both.toml", "--requests", "1", "--parallel", "1"]);
        strong.has_seen(answered + 1).await;
        running.signal(Signal::KILL);
        assert_eq!(running.end().await.code(), None);
        before += answered;
    }
    let (strong, weak) = (says("ACTION: STAY after").await, says("ACTION: STAY").await);
    bench.write("both.toml", &file(&strong, &weak));
    let done = bench.eval(&["both.toml", "--verify"]).await.ends(0);
    done.says(&["resumes", "verified: 2 games"]);
    let serving = bench.serve().await;
    let run = serving.run().await;
    let said = serving.acts(&run).await;
    serving.stop().await;
    let count = |text: &str| said.iter().filter(|(_, act)| act["response"] == text).count();
    let (kept, after) = (count("ACTION: STAY before"), count("ACTION: STAY after"));
    assert_eq!(kept + after, ASKED.0);
    assert_eq!(after, strong.seen().len());
    // Answers whose acts were not stored yet are asked for again.
    assert!((before - 2 * 2..=before).contains(&kept), "{kept} of {before}");
}

/// The server alone plays such a team, so the program has no token of it.
#[tokio::test]
async fn a_team_of_built_in_players_resumes_after_a_kill_and_is_found_again() {
    let bench = Bench::new();
    bench.write(
        "e.toml",
        "tasks = 'Foraging'\nseeds = '0..6'\n[[teams]]\nmembers = [{ player = 'default', seats = '0..6' }, \
         { player = 'random', seats = '6..12' }]\n",
    );
    let args = ["e.toml", "--parallel", "1"];
    let running = bench.start(&args).until_it_says("is new").await;
    running.signal(Signal::KILL);
    assert_eq!(running.end().await.code(), None);
    let done = bench.eval(&[&args[..], &["--verify"]].concat()).await.ends(0);
    done.says(&["resumes", "verified: 6 games"]);
    bench.eval(&args).await.ends(0).says(&["was played before"]);
}

#[tokio::test]
async fn a_game_of_a_team_is_played_again() {
    let bench = Bench::new();
    let (strong, weak) = (says("ACTION: STAY").await, says("ACTION: SWITCH").await);
    bench.write("both.toml", &file(&strong, &weak));
    bench.eval(&["both.toml"]).await.ends(0);
    let again = ["both.toml", "--verify", "--replay-game", "Synchronization/2"];
    let done = bench.eval(&again).await.ends(0);
    done.says(&[
        "plays again what is kept beside it",
        "Synchronization 2 (ep_",
        "verified: 2 games",
    ]);
    assert_eq!((strong.seen().len(), weak.seen().len()), (ASKED.0 / 2 * 3, ASKED.1 / 2 * 3));
}

/// When one model fails, the others do not wait for its seats for ever.
#[tokio::test]
async fn a_member_that_fails_stops_its_team() {
    let bench = Bench::new();
    let strong = says("ACTION: STAY").await;
    let weak = Endpoint::start(|_, _| Reply::error(404, "The model `weak` does not exist")).await;
    bench.write("both.toml", &file(&strong, &weak));
    let done = bench.eval(&["both.toml"]).await.ends(1);
    done.says(&["for the model weak", "does not exist", "0 of 2 games were played"]);
}

fn example() -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/eval/teams.toml").display().to_string()
}

#[test]
fn the_example_is_a_curve_and_a_set() {
    let text = std::fs::read_to_string(example()).expect("the example");
    let plan = Plan::of(&Experiment::from_toml(&text).expect("an experiment"), None, &no_prices);
    let names: Vec<String> = plan.expect("a plan").runs.iter().map(Planned::name).collect();
    assert_eq!(names.len(), 13 + 3, "what the set shares with the curve is played once: {names:?}");
}

fn plan(teams: &str) -> Result<Plan, PlanError> {
    let text = format!(
        "tasks = 'Foraging'\nseeds = 1\nmodels = ['a', 'b', 'c']\napi_base = 'http://127.0.0.1:9/v1'\n\
         settings.num_agents = 4\nteams = [{teams}]"
    );
    Plan::of(&Experiment::from_toml(&text).expect("an experiment"), None, &no_prices)
}

fn names(teams: &str) -> Vec<String> {
    plan(teams).expect("a plan").runs.iter().map(Planned::name).collect()
}

#[test]
fn a_line_is_a_curve_and_a_set_has_its_backgrounds_alone() {
    let curve = "{ substitute = { of = 'a', by = 'built-in/random' } }";
    let expected = [
        "4 a",
        "3 a + 1 built-in/random",
        "2 a + 2 built-in/random",
        "1 a + 3 built-in/random",
        "4 built-in/random",
    ];
    // Models that no team names play alone.
    assert_eq!(names(curve), [&["b", "c"], &expected[..]].concat());
    let some = "{ substitute = { of = 'a', by = 'b', k = [0, '2..=4'] } }";
    assert_eq!(names(some), ["c", "4 a", "2 a + 2 b", "1 a + 3 b", "4 b"]);
    let set = "{ focal = { models = ['a', 'b'], backgrounds = ['b', 'c'], seats = 1 } }";
    assert_eq!(names(set), ["4 b", "3 b + 1 a", "4 c", "3 c + 1 a", "3 c + 1 b"]);
    // What two entries have in common is played once.
    assert_eq!(names(&format!("{curve}, {curve}")), names(curve));
}

#[test]
fn members_have_their_seats_and_the_identity_says_which() {
    let team = |seats: [&str; 2]| {
        plan(&format!(
            "{{ name = 't', members = [{{ model = 'a', seats = {} }}, {{ player = 'default', seats = {} }}] }}",
            seats[0], seats[1]
        ))
    };
    let planned = team(["[0, 3]", "'1..3'"]).expect("a plan").runs.remove(2);
    let Who::Team(of) = &planned.who else { panic!("a team") };
    let seats: Vec<_> = of.members.iter().map(|member| member.seats.clone()).collect();
    assert_eq!((planned.name(), seats), ("t".to_owned(), vec![vec![0, 3], vec![1, 2]]));
    let request = planned.request(1);
    assert_eq!(request.holders.map(|holders| holders.len()), Some(2));
    let other = team(["[0, 1]", "'2..4'"]).expect("a plan").runs.remove(2);
    assert_ne!(planned.identity(), other.identity());
    for (seats, problem) in [
        (["[0, 1, 4]", "[2, 3]"], "`seats` of a team goes to 3, and has 4"),
        (["[0, 1]", "3"], "the seat 2 has 0 members"),
        (["[0, 1]", "'1..4'"], "the seat 1 has 2 members"),
    ] {
        let problems = team(seats).expect_err("a fault").to_string();
        assert!(problems.contains(problem), "{problems}");
    }
}

#[test]
fn what_is_no_team_is_refused() {
    for (team, problem) in [
        ("{ name = 'x' }", "either `members`"),
        ("{ name = 'x', substitute = { of = 'a', by = 'b' } }", "either `members`"),
        ("{ substitute = { of = 'a', by = 'd' } }", "the model \"d\", which is not in `models`"),
        ("{ substitute = { of = 'a', by = 'b', k = 5 } }", "`k` of a team goes to 4, and has 5"),
        ("{ substitute = { of = 'a', by = 'built-in/nobody' } }", "nobody"),
        ("{ focal = { models = 'a', backgrounds = 'b', seats = 4 } }", "1 to 3 of 4 seats, not 4"),
        ("{ members = [{ seats = '0..4' }] }", "either a `model` or a `player`"),
    ] {
        let problems = plan(team).expect_err(team).to_string();
        assert!(problems.contains(problem), "{team}: {problems}");
    }
}

/// A short file can name more than any machine holds.
#[test]
fn what_is_too_much_is_refused_before_it_is_made() {
    let refused = |settings: &str, teams: &str| {
        let text = format!(
            "tasks = 'Foraging'\nseeds = 1\nmodels = ['a', 'b', 'c']\nteams = [{teams}]\n[settings]\n{settings}"
        );
        let read = Experiment::from_toml(&text).expect("an experiment");
        Plan::of(&read, None, &no_prices).expect_err("too much").to_string()
    };
    let curve = "{ substitute = { of = 'a', by = 'b' } }, ";
    assert_eq!(refused("num_agents = 65535", curve), "num_agents must be from 1 to 1024, is 65535");
    let runs = |fields: &str| {
        format!(
            "{fields} and the combinations of `settings` make more than {RUNS_MAX} runs, the most of an experiment: play it in parts"
        )
    };
    let some = "{ substitute = { of = 'a', by = 'b', k = ['0..=3', 4] } }, ";
    let many = |name: &str| format!("[{}]", format!("'{name}',").repeat(100));
    let strangers = format!(
        "{{ focal = {{ models = {}, backgrounds = {}, seats = 1 }} }}",
        many("a"),
        many("b")
    );
    for teams in [curve.repeat(1000), some.repeat(1000), strangers] {
        assert_eq!(refused("num_agents = 4", &teams), runs("`teams`"));
    }
    let list = |count: usize| (1..=count).map(|n| n.to_string()).collect::<Vec<_>>().join(", ");
    let axes = format!("memory = [{}]\nmax_round = [{}]", list(50), list(50));
    assert_eq!(refused(&axes, ""), runs("`models`, `players`"));
    let members = "{ model = 'a', seats = 0 }, ".repeat(65);
    let team = format!("{{ members = [{members}] }}");
    assert_eq!(refused("num_agents = 4", &team), "a team has at most 64 `members`, not 65");
    let team = "{ members = [{ model = 'a', seats = [0, 1, 2, 3] }] }, ".repeat(1000);
    let long = "x".repeat(20_000);
    let text = format!(
        "tasks = 'Foraging'\nseeds = 1\nmodels = 'a'\nextra = {{ user = '{long}' }}\nteams = [{team}]\n[settings]\nnum_agents = 4"
    );
    let read = Experiment::from_toml(&text).expect("an experiment");
    let said = Plan::of(&read, None, &no_prices).expect_err("too much").to_string();
    assert!(said.contains("for 4000 models of all runs: together at most"), "{said}");
    for ranges in ["'0..1000', ".repeat(101), "'0..1000', 1000".to_owned()] {
        let text = format!("models = 'a'\nseeds = [{ranges}]");
        let read = Experiment::from_toml(&text).expect("an experiment");
        let said = Plan::of(&read, None, &no_prices).expect_err("too much").to_string();
        assert!(said.starts_with("`seeds` has more than 1000 numbers"), "{said}");
    }
}

/// No member's temperature is shown as that of its team.
#[test]
fn members_of_several_temperatures_are_told_with_their_names() {
    let told = |a: &str, b: &str| {
        let text = format!(
            "tasks = 'Foraging'\nseeds = 1\nmodels = [{{ name = 'a', {a} }}, {{ name = 'b', {b} }}]\n\
             settings.num_agents = 4\nteams = [{{ substitute = {{ of = 'a', by = 'b', k = 1 }} }}]"
        );
        let read = Experiment::from_toml(&text).expect("an experiment");
        let run = Plan::of(&read, None, &no_prices).expect("a plan").runs.remove(0);
        (run.setting("temperature"), run.further_sampling())
    };
    let text = |text: &str| Some(text.to_owned());
    assert_eq!(
        told("temperature = 0.2, effort = 'low'", "temperature = 0.8, effort = 'low'"),
        (None, text("a: effort low, temperature 0.2; b: effort low, temperature 0.8"))
    );
    assert_eq!(
        told("temperature = 0.2", "top_p = 1"),
        (None, text("a: temperature 0.2; b: top_p 1.0"))
    );
    assert_eq!(told("temperature = 0.2", "temperature = 0.2"), (text("0.2"), None));
}

/// All seats of a game have one reader of answers.
#[test]
fn a_member_with_another_shape_of_answers_is_refused() {
    let plan = |experiment: &str, of_a: &str| {
        let text = format!(
            "tasks = 'Foraging'\nseeds = 1\n{experiment}\nsettings.num_agents = 4\n\
             models = [{{ name = 'a', {of_a} }}, {{ name = 'b' }}]\nteams = [{{ substitute = {{ of = 'a', by = 'b' }} }}]"
        );
        Plan::of(&Experiment::from_toml(&text).expect("an experiment"), None, &no_prices)
    };
    let problems = plan("", "harness.answer = 'json'").expect_err("a fault").to_string();
    assert!(problems.starts_with("a: `harness.answer` of a model"), "{problems}");
    assert!(problems.contains("write `answer` into `[harness]`"), "{problems}");
    assert!(plan("harness.answer = 'json'", "harness.answer = 'json'").is_ok());
    assert!(plan("", "harness.answer = 'markers'").is_ok());
}

/// Otherwise a recording would answer in one team what it answered in another.
#[test]
fn a_game_of_a_team_has_the_team_in_its_name() {
    let runs = plan("{ substitute = { of = 'a', by = 'b' } }").expect("a plan").runs;
    let names: std::collections::BTreeSet<String> = runs
        .iter()
        .map(|run| run.game_name("Foraging", swarmbench_engine::Seed::from(1)))
        .collect();
    assert_eq!((runs.len(), names.len()), (1 + 5, 1 + 5));
}
