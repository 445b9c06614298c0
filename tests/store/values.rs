//! Order, texts and numbers, to the byte.

use jiff::Timestamp;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions as _, Connection as _};
use swarmbench::ids::{CompetitionKey, EpisodeId, EpisodeKey, RunKey, TokenHash};
use swarmbench::keys::{Key, KeyRow, Role};
use swarmbench::store::entries::{
    CompetitionRow, EntrantRow, Entry, OpeningRow, RoundRow, RunRow, Secret,
};
use swarmbench::store::episodes::Filter;
use swarmbench::store::runs::RunFilter;
use swarmbench_journal::chain::Head;
use swarmbench_journal::record::RawRecord;
use swarmbench_protocol::names;
use swarmbench_testkit::dice::Dice;
use swarmbench_testkit::needs;

use crate::store::Pair;
use crate::store::history::NAMED;
use crate::store::numbers::Names;

fn at(ms: i64) -> Timestamp {
    Timestamp::from_millisecond(ms).expect("a time")
}

fn opening(key: i64, model: &str) -> Entry {
    Entry::Open(Box::new(OpeningRow {
        episode: EpisodeKey(key),
        id: EpisodeId::from_text(format!("ep_{key}")),
        owner: None,
        run: None,
        fork: None,
        record: RawRecord::write(&serde_json::json!({"config": {"start": "now"}})),
        head: Head([1; 32]),
        task: "foraging",
        model: model.to_owned(),
        visibility: "public",
        waiting: false,
        is_mixed: false,
        has_people: false,
        own_games: false,
        clocked: false,
        at: at(0),
        idempotency: None,
        tokens: Vec::new(),
    }))
}

fn run(key: i64, model: &str) -> Entry {
    Entry::OpenRun(Box::new(RunRow {
        run: RunKey(key),
        id: format!("run_{key}"),
        owner: None,
        suite: model.to_owned(),
        digest: String::new(),
        definition: "{}".to_owned(),
        model: model.to_owned(),
        visibility: "public",
        attempt: None,
        replays: None,
        closes_at: None,
        at: at(key),
        idempotency: Some((format!("/{model}"), [3; 32])),
    }))
}

fn cup() -> Entry {
    Entry::AddCompetition(Box::new(CompetitionRow {
        id: "cup".to_owned(),
        definition: "{}".to_owned(),
        salt: Secret(vec![0, 255]),
        seeds: Secret(Vec::new()),
        commitment: [9; 32],
        opens_at: at(0),
        closes_at: at(i64::from(u32::MAX)),
        at: at(0),
    }))
}

fn key(id: &str, name: &str) -> Entry {
    let key = Key {
        number: None,
        id: id.to_owned(),
        role: Role::Entrant,
        name: name.to_owned(),
        created_at: at(0),
        expires_at: None,
        revoked_at: None,
    };
    Entry::AddKey(Box::new(KeyRow { key, hash: TokenHash::of(id), acts_for: None }))
}

/// An entrant of the first competition.
fn entrant(id: &str, owner: &str, name: &str) -> EntrantRow {
    EntrantRow {
        id: id.to_owned(),
        competition: CompetitionKey(0),
        owner: owner.to_owned(),
        name: name.to_owned(),
        model: name.to_owned(),
        declaration: "{}".to_owned(),
        template: None,
        vouched: false,
        invitation: None,
        address: None,
        category: None,
        terms: Some(i32::MAX.unsigned_abs()),
        contact: None,
        at: at(0),
    }
}

fn round(number: u32, score: f64) -> Entry {
    let (digest, head) = ([0; 32], Head([255; 32]));
    let at = at(i64::from(number));
    Entry::Round(RoundRow { episode: EpisodeKey(1), round: number, digest, score, head, at })
}

#[needs(postgres)]
#[tokio::test]
async fn texts_are_ordered_and_found_by_their_bytes() {
    let mut pair = Pair::new().await;
    let mut names = Names { competitions: vec!["cup".to_owned()], ..Names::default() };
    let mut first = vec![cup()];
    for (number, name) in (1..).zip(NAMED) {
        first.extend([opening(number, name), run(number, name)]);
    }
    assert_eq!(pair.keep(&[first], &names).await, [true]);
    let mut entrants = Vec::new();
    for (number, name) in NAMED.into_iter().enumerate() {
        let id = format!("key_{number}");
        names.keys.push(id.clone());
        names.entries.push(format!("entry_{number}"));
        entrants.push(key(&id, name));
        let row = entrant(&format!("entry_{number}"), &id, name);
        entrants.push(Entry::AddEntrant(Box::new(row)));
    }
    assert_eq!(pair.keep(&[entrants], &names).await, [true]);
    for (name, side) in [("SQLite", &pair.sqlite), ("PostgreSQL", &pair.postgres)] {
        let store = &side.store;
        for model in NAMED {
            let of_model = Filter { model: Some(model.to_owned()), ..Filter::default() };
            let found = store.list_episodes(&of_model, None, 100).await.expect("read");
            assert_eq!(found.len(), 1, "{name} tells {model:?} from others");
        }
        for model in ["\0", "model-a\0", "\0model-a", "🐝\0"] {
            let model = Some(model.to_owned());
            let played_by = model.clone();
            let filter = Filter { model: model.clone(), played_by, ..Filter::default() };
            let found = store.list_episodes(&filter, None, 100).await;
            assert!(found.is_ok_and(|found| found.is_empty()), "{name} finds nothing");
            let filter = RunFilter { model: model.clone(), suite: model, ..RunFilter::default() };
            let found = store.list_runs(&filter, None, 100).await;
            assert!(found.is_ok_and(|found| found.is_empty()), "{name} finds nothing");
        }
        assert!(store.run_created_with("/model-a\0").await.is_ok_and(|found| found.is_none()));
        assert!(store.find_run("run_1\0").await.is_ok_and(|found| found.is_none()));
    }
    // The order that the engines themselves give.
    let written = "SELECT DISTINCT name FROM entries ORDER BY name";
    let file = SqliteConnectOptions::new().filename(pair.file());
    let mut file = file.connect().await.expect("it opens");
    let of_sqlite: Vec<String> =
        sqlx::query_scalar(written).fetch_all(&mut file).await.expect("read");
    file.close().await.expect("it closes");
    let mut server = pair.scratch.connect().await;
    let of_postgres: Vec<String> =
        sqlx::query_scalar(written).fetch_all(&mut server).await.expect("read");
    server.close().await.expect("it closes");
    let mut by_bytes = NAMED.map(str::to_owned);
    by_bytes.sort_unstable();
    assert_eq!(of_sqlite, by_bytes);
    assert_eq!(of_postgres, by_bytes);
    pair.close().await;
}

/// PostgreSQL compares what has U+0000 with another text in place of it. That one is in no name, so that it finds nothing.
#[test]
fn no_name_has_what_stands_for_a_nul() {
    for name in ["a\0b", "a\u{ffff}b", "\u{ffff}"] {
        assert!(names::check(name, 100).is_err(), "{name:?} is no name");
        assert!(names::check_model(name, 100).is_err(), "{name:?} is no model");
    }
}

#[needs(postgres)]
#[tokio::test]
async fn numbers_keep_their_bits() {
    let mut pair = Pair::new().await;
    let scores = [
        0.0,
        -0.0,
        1.0,
        -1.0,
        5e-324,
        -5e-324,
        f64::MIN_POSITIVE / 3.0,
        f64::MAX,
        f64::MIN,
        0.1 + 0.2,
        1.0 / 3.0,
        9_007_199_254_740_993.0,
        1e22,
        9.223_372_036_854_775e18,
        -9.3e18,
        f64::EPSILON,
    ];
    let rounds = (0..).zip(scores).map(|(number, score)| round(number, score));
    let job = [opening(1, "a"), opening(i64::MAX - 1, "b")].into_iter().chain(rounds).collect();
    assert_eq!(pair.keep(&[job], &Names::default()).await, [true]);
    // By the statement for acts and rounds alone, too.
    let more = (100..).zip(scores).map(|(number, score)| round(number, score)).collect();
    assert_eq!(pair.keep(&[more], &Names::default()).await, [true]);
    for (is_sqlite, side) in [(true, &pair.sqlite), (false, &pair.postgres)] {
        for from in [0, 100] {
            let stored = side.store.resolved(EpisodeKey(1), from, from + 50).await.expect("read");
            let stored: Vec<_> = stored.into_iter().map(|round| round.score.to_bits()).collect();
            // SQLite itself stores -0.0 as 0.0, which no score is.
            let kept = scores.map(|score| if is_sqlite && score == 0.0 { 0.0 } else { score });
            assert_eq!(stored, kept.map(f64::to_bits), "PostgreSQL: {}", !is_sqlite);
        }
        let listed = side.store.list_episodes(&Filter::default(), None, 10).await.expect("read");
        let keys: Vec<_> = listed.into_iter().map(|episode| episode.episode.0).collect();
        assert_eq!(keys, [i64::MAX - 1, 1]);
        assert_eq!(side.store.last_key().await.expect("read"), i64::MAX - 1);
    }
    pair.close().await;
}

/// The longest names: PostgreSQL takes about 2,700 bytes into a row of an index, after it has compressed them. A look has at most 400
/// characters.
#[needs(postgres)]
#[tokio::test]
async fn the_longest_names_fit_into_indexes() {
    let mut pair = Pair::new().await;
    // Characters that look like many others, and different ones, which compress badly.
    let mut chars: Vec<char> =
        ('\u{80}'..=char::MAX).filter(|c| names::check(&c.to_string(), 1).is_ok()).collect();
    let bytes = |c: &char| {
        let name = c.to_string();
        names::looks(&name).iter().map(String::len).max().unwrap_or(0) + name.len()
    };
    chars.sort_by_cached_key(|c| std::cmp::Reverse(bytes(c)));
    chars.truncate(3000);
    let dice = Dice::of(1, "names");
    let mut longest = |count| -> String {
        (0..count).map(|_| chars.swap_remove(dice.below(chars.len()))).collect()
    };
    let (model, name) = (longest(200), longest(100));
    let look = names::looks(&model)[0].clone();
    assert_eq!(look.chars().count(), "small ".len() + 400, "its look is as long as looks are");
    assert!(look.len() > 1000, "its characters are long");
    let mut names = Names { competitions: vec!["cup".to_owned()], ..Names::default() };
    names.keys.push("key".to_owned());
    names.entries.push("entry".to_owned());
    let jobs = [vec![cup(), key("key", &name), opening(1, &model), run(1, &model)]];
    assert_eq!(pair.keep(&jobs, &names).await, [true]);
    let entrant = EntrantRow { model, ..entrant("entry", "key", &name) };
    let jobs = [vec![Entry::AddEntrant(Box::new(entrant))]];
    assert_eq!(pair.keep(&jobs, &names).await, [true]);
    pair.close().await;
}
