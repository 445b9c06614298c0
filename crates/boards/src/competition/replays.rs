//! Replays of the journals of a file on several threads, concurrently with reading it.

use std::io::{BufRead, Cursor, Read};
use std::num::NonZero;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Mutex, PoisonError};
use std::thread;

use swarmbench_engine::physics::Solver;
use swarmbench_journal::chain::Head;
use swarmbench_journal::replay::{self, JournalReport, verify};

/// Maximum replaying threads.
const THREADS_MAX: usize = 64;

/// Journals of at least this many bytes are replayed as they are read; smaller ones are kept in memory until a thread is free.
const JOURNAL_BYTES_MAX: usize = 512 * 1024;

/// Pending journals per thread, so that no thread waits for the file.
const PENDING_PER_THREAD: usize = 4;

type Result = std::result::Result<JournalReport, replay::Fault>;

/// Threads that replay journals.
pub(super) struct Replays {
    jobs: SyncSender<Job>,
    solver: Solver,
    threads: usize,
}

struct Job {
    journal: Vec<u8>,
    head: Head,
    done: SyncSender<Result>,
}

/// A journal that is being replayed.
pub(super) struct Waiting {
    played: Receiver<Result>,
    /// Lines of the journal that the file lacks.
    pub(super) left: usize,
}

impl Replays {
    /// Runs `work` beside threads that replay the journals it begins.
    pub(super) fn run<T>(solver: Solver, work: impl FnOnce(&Self) -> T) -> T {
        let threads = thread::available_parallelism().map_or(1, NonZero::get).min(THREADS_MAX);
        let (jobs, next) = sync_channel::<Job>(threads * PENDING_PER_THREAD);
        let next = Mutex::new(next);
        thread::scope(|scope| {
            for _ in 0..threads {
                scope.spawn(|| {
                    loop {
                        let taken = next.lock().unwrap_or_else(PoisonError::into_inner).recv();
                        // The sender was dropped: the work is done.
                        let Ok(Job { journal, head, done }) = taken else { return };
                        let played = verify(journal.as_slice(), Some(head), solver, |_, _| {});
                        // The receiver is gone after an earlier fault.
                        drop(done.send(played));
                    }
                });
            }
            let replays = Self { jobs, solver, threads };
            work(&replays)
        })
    }

    /// Maximum pending journals.
    pub(super) const fn pending_max(&self) -> usize {
        self.threads * PENDING_PER_THREAD
    }

    /// Begins to replay the next journal of the file, of `lines` lines.
    ///
    /// # Errors
    /// If the file cannot be read.
    pub(super) fn begin(
        &self,
        file: &mut impl BufRead,
        lines: usize,
        head: Head,
    ) -> std::io::Result<Waiting> {
        let (done, played) = sync_channel(1);
        let (mut journal, mut left) = (Vec::new(), lines);
        while left > 0
            && journal.len() < JOURNAL_BYTES_MAX
            && file.read_until(b'\n', &mut journal)? > 0
        {
            left -= 1;
        }
        if journal.len() < JOURNAL_BYTES_MAX {
            // The receiver outlives `self`.
            drop(self.jobs.send(Job { journal, head, done }));
        } else {
            let mut rest = Section { file, left };
            let all = Cursor::new(journal).chain(&mut rest);
            drop(done.send(verify(all, Some(head), self.solver, |_, _| {})));
            left = rest.left;
        }
        Ok(Waiting { played, left })
    }
}

impl Waiting {
    /// Result of the replay.
    pub(super) fn played(self) -> Result {
        let stopped = || replay::Fault::Whole("the thread that replayed it has stopped".to_owned());
        self.played.recv().unwrap_or_else(|_| Err(stopped()))
    }
}

/// A limited number of lines of a file.
struct Section<'a, R> {
    file: &'a mut R,
    left: usize,
}

impl<R: BufRead> BufRead for Section<'_, R> {
    fn fill_buf(&mut self) -> std::io::Result<&[u8]> {
        if self.left == 0 {
            return Ok(&[]);
        }
        let bytes = self.file.fill_buf()?;
        let ends = bytes.iter().enumerate().filter(|(_, byte)| **byte == b'\n');
        let end = ends.map(|(place, _)| place + 1).nth(self.left - 1).unwrap_or(bytes.len());
        Ok(&bytes[..end])
    }

    fn consume(&mut self, count: usize) {
        // `fill_buf` has returned these bytes before, so they are still there.
        let ends = self
            .file
            .fill_buf()
            .map_or(0, |bytes| bytes.iter().take(count).filter(|byte| **byte == b'\n').count());
        self.left = self.left.saturating_sub(ends);
        self.file.consume(count);
    }
}

impl<R: BufRead> Read for Section<'_, R> {
    fn read(&mut self, into: &mut [u8]) -> std::io::Result<usize> {
        let bytes = self.fill_buf()?;
        let count = bytes.len().min(into.len());
        into[..count].copy_from_slice(&bytes[..count]);
        self.consume(count);
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    #[test]
    fn a_section_ends_after_its_lines_for_any_size_of_the_buffer() {
        let text = "a\nbb\nccc\ndddd\n";
        for buffer in 1..20 {
            for lines in 0..6 {
                let mut file = std::io::BufReader::with_capacity(buffer, Cursor::new(text));
                let mut section = Section { file: &mut file, left: lines };
                let mut read = String::new();
                section.read_to_string(&mut read).expect("text");
                let expected: String = text.split_inclusive('\n').take(lines).collect();
                assert_eq!(read, expected);
                let mut rest = String::new();
                file.read_to_string(&mut rest).expect("text");
                assert_eq!(format!("{read}{rest}"), text);
            }
        }
    }
}
