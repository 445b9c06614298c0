//! Replay of stored episodes. Journal lines are read on demand, so memory use is independent of the journal's length.

use super::sql::{Connection, FromRow, query};
use std::io::{BufReader, Read};

use swarmbench_engine::physics::Solver;

use crate::ids::EpisodeKey;
use swarmbench_journal::chain::Head;
use swarmbench_journal::record::{RawRecord, next_line, round_record};
use swarmbench_journal::replay::{JournalReport, verify};

/// Lines of a journal that are read ahead of their replay.
const AHEAD: usize = 4;

/// An episode's records from the database.
pub(super) struct StoredJournal {
    pub(super) episode: EpisodeKey,
    pub(super) opening: RawRecord,
    /// A fork's first round after the ones it took over; 0 for other episodes. The seating record precedes it.
    pub(super) first_round: u32,
    pub(super) seating: Option<RawRecord>,
    pub(super) rounds: u32,
    /// The end record and the last head of the chain, once the episode has ended.
    pub(super) ending: Option<(RawRecord, Head)>,
}

/// Replays and verifies an episode's journal line by line.
pub(super) async fn replay_stored(
    database: &mut Connection,
    stored: &StoredJournal,
) -> Result<Result<JournalReport, String>, sqlx::Error> {
    let head = stored.ending.as_ref().map(|(_, head)| *head);
    read_journal(database, stored, move |journal| {
        verify(journal, head, Solver::Flow, |_, _| ()).map_err(|fault| fault.to_string())
    })
    .await
}

/// Streams the journal of an episode to `read`, which runs on a blocking thread.
pub(super) async fn read_journal<T: Send + 'static>(
    database: &mut Connection,
    stored: &StoredJournal,
    read: impl FnOnce(BufReader<Lines>) -> Result<T, String> + Send + 'static,
) -> Result<Result<T, String>, sqlx::Error> {
    let (send, receive) = tokio::sync::mpsc::channel(AHEAD);
    let played = tokio::task::spawn_blocking(move || {
        read(BufReader::new(Lines { receive, line: Vec::new(), read: 0 }))
    });
    // `read` drops the receiver at the first fault.
    let sent = send_lines(database, stored, &send).await;
    drop(send);
    sent?;
    Ok(played.await.unwrap_or_else(|panic| Err(panic.to_string())))
}

async fn send_lines(
    database: &mut Connection,
    stored: &StoredJournal,
    lines: &tokio::sync::mpsc::Sender<Vec<u8>>,
) -> Result<(), sqlx::Error> {
    let (opening, mut head) = next_line(&stored.opening, Head::START);
    let mut is_received = lines.send(opening.into()).await.is_ok();
    for round in 0..=stored.rounds {
        if let Some(seating) = stored.seating.as_ref().filter(|_| round == stored.first_round) {
            let (line, _) = next_line(seating, head);
            is_received = lines.send(line.into()).await.is_ok();
        }
        if !is_received {
            return Ok(());
        }
        if round < stored.rounds {
            let line;
            (line, head) = round_line(database, stored.episode, round).await?;
            is_received = lines.send(line.into()).await.is_ok();
        }
    }
    if let Some((ending, head)) = &stored.ending {
        _ = lines.send(ending.line(*head).into()).await;
    }
    Ok(())
}

async fn round_line(
    database: &mut Connection,
    episode: EpisodeKey,
    round: u32,
) -> Result<(String, Head), sqlx::Error> {
    let text = "SELECT record FROM acts WHERE episode = $1 AND round = $2 ORDER BY agent";
    let acts = query(text).bind(episode.0).bind(round).fetch_all(&mut *database).await?;
    let acts = acts.iter().map(RawRecord::from_row).collect::<Result<Vec<_>, _>>()?;
    let text = "SELECT digest, score, head FROM rounds WHERE episode = $1 AND round = $2";
    let row = query(text).bind(episode.0).bind(round).fetch_one(database).await?;
    let (digest, score, head): ([u8; 32], f64, Head) = FromRow::from_row(&row)?;
    let digest = data_encoding::HEXLOWER.encode(&digest);
    let record = round_record(round, acts.iter(), &digest, score);
    Ok((record.line(head), head))
}

/// Lines received from a channel, as a reader.
pub(super) struct Lines {
    receive: tokio::sync::mpsc::Receiver<Vec<u8>>,
    line: Vec<u8>,
    read: usize,
}

impl Read for Lines {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        if self.read == self.line.len() {
            let Some(next) = self.receive.blocking_recv() else { return Ok(0) };
            (self.line, self.read) = (next, 0);
        }
        let read = (&self.line[self.read..]).read(buffer)?;
        self.read += read;
        Ok(read)
    }
}
