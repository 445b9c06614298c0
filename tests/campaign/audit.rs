//! Checks after all games: journals, ledger and database must tell the same.

use std::collections::BTreeMap;
use std::path::Path;

use reqwest::Method;
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, Connection};
use swarmbench::store::Location;
use swarmbench_engine::AgentId;
use swarmbench_engine::physics::Solver;
use swarmbench_journal::chain::Head;
use swarmbench_journal::record::{ActRecord, End, RawRecord, Record, Round, Source};
use swarmbench_journal::replay::verify;
use swarmbench_protocol::episode::EpisodeList;
use swarmbench_testkit::program::{Server, Site, complaints};

use crate::campaign::clients::Clients;
use crate::campaign::ledger::{Played, Sent};

/// Contents of the journals.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Totals {
    pub(crate) episodes: u64,
    pub(crate) rounds: u64,
    pub(crate) acts: u64,
    pub(crate) acts_by_clock: u64,
}

/// Everything that can be checked once all games are over: with the running server, then with its file.
pub(crate) async fn audit(site: &Site, server: Server, clients: &Clients) -> Totals {
    audit_after(site, server, clients, &[]).await
}

/// The same of a server that had reasons to complain: about what its log says with one of these words.
pub(crate) async fn audit_after(
    site: &Site,
    server: Server,
    clients: &Clients,
    reasons: &[&str],
) -> Totals {
    let totals = journals(clients).await;
    let (status, _, log) = server.terminate().await;
    assert_eq!(status.code(), Some(0), "{log:#?}");
    let has_reason = |line: &&String| reasons.iter().any(|reason| line.contains(reason));
    let unexpected: Vec<_> =
        complaints(&log).into_iter().filter(|line| !has_reason(line)).collect();
    assert_eq!(unexpected, Vec::<&String>::new());
    check_left_behind(site).await;
    totals
}

/// Compares the journals of all episodes with the ledger.
pub(crate) async fn journals(clients: &Clients) -> Totals {
    let mut totals = Totals::default();
    for played in clients.ledger.all() {
        journal(clients, &played, &mut totals).await;
    }
    assert_eq!(episodes(clients).await, totals.episodes, "an episode was created twice");
    totals
}

/// Files of a server that has stopped in good order.
pub(crate) async fn check_left_behind(site: &Site) {
    if site.is_on_postgres() {
        return check_database(site.direct().parse().expect("a location")).await;
    }
    assert!(!site.wal().exists(), "what was written lately is not in the database");
    integrity(Path::new(site.db())).await;
}

/// Checks everything in a database that no server has.
pub(crate) async fn check_database(location: Location) {
    let formats = &swarmbench::competitions::FORMATS;
    let checked = swarmbench::store::check::check(location, formats, |_, _| ()).await;
    let checked = checked.expect("it can be checked");
    assert!(checked.is_sound(), "{:?}", checked.damages);
}

/// `PRAGMA integrity_check`, on a file that no server has open.
pub(crate) async fn integrity(db: &Path) {
    let options = SqliteConnectOptions::new().filename(db).create_if_missing(false);
    let mut connection = options.connect().await.expect("it opens");
    let found: Vec<String> = sqlx::query_scalar("PRAGMA integrity_check")
        .fetch_all(&mut connection)
        .await
        .expect("it can be checked");
    connection.close().await.expect("it closes");
    assert_eq!(found, ["ok"], "{}", db.display());
}

/// Episodes of the clients that the server lists.
async fn episodes(clients: &Clients) -> u64 {
    let (mut count, mut cursor) = (0, String::new());
    loop {
        let path = format!("/api/v1/episodes?limit=1000{cursor}");
        let page: EpisodeList = clients.read(&path).await.read();
        let by_clients = page.items.iter().filter(|item| item.model.starts_with("campaign "));
        count += by_clients.count() as u64;
        let Some(next) = page.next_cursor else { return count };
        cursor = format!("&cursor={next}");
    }
}

/// Plays the journal of an episode again, and compares it with what its clients know.
async fn journal(clients: &Clients, played: &Played, totals: &mut Totals) {
    let name = played.name();
    let shown = clients.summary(played).await.result.expect("it has ended");
    played.ended(&shown);
    let path = format!("/api/v1/episodes/{}/journal", played.created.id);
    let text = clients.call(Method::GET, &path, &played.created.swarm_token).await.text();
    let head = Head::parse(&shown.journal_head).expect("a head");
    let report = verify(text.as_bytes(), Some(head), Solver::Flow, |_, _| ());
    let report = report.unwrap_or_else(|fault| panic!("{name}: {fault}"));
    assert_eq!(report.rounds, shown.rounds, "{name}");

    let (rounds, end) = records(&text);
    let scores = played.scores();
    for (round, score) in rounds.iter().map(|record| (record.round + 1, record.score)) {
        // A client that saw the state after a round saw the score that the journal has.
        if let Some(seen) = scores.get(&round) {
            assert_eq!(seen.to_bits(), score.to_bits(), "{name}: the score after {round} rounds");
        }
    }
    let open = end.open_acts.iter().map(|act| (end.rounds, act));
    let kept = rounds.iter().flat_map(|record| record.acts.iter().map(|act| (record.round, act)));
    let kept: BTreeMap<(AgentId, u32), &ActRecord> = kept
        .chain(open)
        .map(|(round, act)| ((AgentId::parse(&act.agent).expect("an agent"), round), act))
        .collect();
    let sent = played.acts();
    for (place, act) in &kept {
        assert!(
            act.source == Source::Clock || sent.contains_key(place),
            "{name}: nobody sent {act:?}"
        );
    }
    let came_late = sent.values().any(|sent| sent.refused);
    assert!(!came_late || played.game.is_clocked(), "{name}: nobody was late");
    for (place, sent) in &sent {
        compare(&name, *place, sent, kept.get(place).copied());
    }
    totals.episodes += 1;
    totals.rounds += u64::from(report.rounds);
    totals.acts += kept.values().filter(|act| act.source == Source::Player).count() as u64;
    totals.acts_by_clock += kept.values().filter(|act| act.source == Source::Clock).count() as u64;
}

/// The rounds and the end of a journal that was verified.
fn records(journal: &str) -> (Vec<Round>, End) {
    #[derive(serde::Deserialize)]
    struct Line {
        record: Box<serde_json::value::RawValue>,
    }
    let mut rounds = Vec::new();
    let mut end = None;
    for line in journal.lines() {
        let Line { record } = serde_json::from_str(line).expect("a line");
        let raw = RawRecord::from_stored(record.get().to_owned()).expect("JSON");
        match raw.read().expect("a record") {
            Record::Opening(_) | Record::Seats(_) => {}
            Record::Round(round) => rounds.push(round),
            Record::End(found) => end = Some(found),
        }
    }
    (rounds, end.expect("an end"))
}

/// An act that was acknowledged is in the journal as it was sent and acknowledged; one that was refused is not.
fn compare(name: &str, (agent, round): (AgentId, u32), sent: &Sent, kept: Option<&ActRecord>) {
    let Some(receipt) = &sent.receipt else {
        assert!(sent.refused, "{name}: the act of {agent} in {round} was given up");
        let by_player = kept.is_some_and(|act| act.source == Source::Player);
        assert!(!by_player, "{name}: the act of {agent} in {round} was refused and is kept");
        return;
    };
    let kept =
        kept.unwrap_or_else(|| panic!("{name}: {agent} in {round} is not kept: {receipt:?}"));
    assert_eq!(kept.source, Source::Player, "{name}: {agent} in {round}: {receipt:?}");
    assert_eq!(
        (&kept.action, &kept.message, kept.valid),
        (&receipt.action, &receipt.message, receipt.valid),
        "{name}: {agent} in {round}"
    );
    let request = &sent.request;
    assert_eq!(
        (&kept.response, &kept.reasoning),
        (&request.response, &request.reasoning),
        "{name}: {agent} in {round}"
    );
    assert_eq!(
        kept.usage.as_ref().map(|usage| (usage.prompt_tokens, usage.completion_tokens)),
        request.usage.map(|usage| (usage.prompt_tokens, usage.completion_tokens)),
        "{name}: {agent} in {round}"
    );
    if request.response.is_none() {
        assert_eq!(kept.to, request.to, "{name}: {agent} in {round}");
    }
}
