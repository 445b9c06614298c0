//! A bounded memory of games: a player that runs for days meets any number of them.

use std::collections::HashMap;

/// Games in memory. At the limit the half that was seen longest ago is forgotten; far fewer are open at a time
/// (`run_parallel_max`).
const GAMES_REMEMBERED_MAX: usize = 512;

/// Values of games that were seen lately.
pub(super) struct Recent<V> {
    turn: u64,
    games: HashMap<String, (u64, V)>,
}

impl<V> Default for Recent<V> {
    fn default() -> Self {
        Self { turn: 0, games: HashMap::new() }
    }
}

impl<V> Recent<V> {
    /// Returns the value of a game and marks the game as seen.
    pub(super) fn of(&mut self, episode: &str, make: impl FnOnce() -> V) -> &mut V {
        self.turn += 1;
        if self.games.len() >= GAMES_REMEMBERED_MAX && !self.games.contains_key(episode) {
            self.forget_half();
        }
        let (seen, value) =
            self.games.entry(episode.to_owned()).or_insert_with(|| (self.turn, make()));
        *seen = self.turn;
        value
    }

    fn forget_half(&mut self) {
        let mut turns: Vec<u64> = self.games.values().map(|(seen, _)| *seen).collect();
        turns.sort_unstable();
        let middle = turns[turns.len() / 2];
        self.games.retain(|_, (seen, _)| *seen >= middle);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_games_that_were_seen_last_are_remembered() {
        let mut recent = Recent::default();
        for game in 0..10_000_u32 {
            *recent.of(&game.to_string(), || 0) = game;
            assert_eq!(*recent.of("the active one", || 7), 7);
            assert!(recent.games.len() <= GAMES_REMEMBERED_MAX);
        }
        for game in 9_900..10_000_u32 {
            assert_eq!(*recent.of(&game.to_string(), || 0), game);
        }
        assert_eq!(*recent.of("1", || 0), 0, "it is forgotten");
    }
}
