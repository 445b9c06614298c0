//! Changes of a competition by an organizer before it closes: texts, terms, and later ends. A window is extended and never
//! shortened, so that nobody has less time than was announced.

use jiff::Timestamp;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use swarmbench_protocol::competition::Terms;

use super::definition::{Definition, OwnGames, Problem, Window};

/// A change; `None` leaves a field as it is.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Change {
    /// New name.
    pub name: Option<String>,
    /// New description.
    pub description: Option<String>,
    /// Later end. Windows that end with the competition end with it again.
    pub closes_at: Option<Timestamp>,
    /// Attempts, counted from 1, and the later ends of their windows.
    pub windows: Vec<(u32, Timestamp)>,
    /// New terms, as their next version.
    pub terms: Option<String>,
}

/// A field before and after a change.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Changed {
    /// Field of the definition, such as `attempts[0].closes_at`.
    pub field: String,
    /// Value before.
    pub from: Value,
    /// Value after.
    pub to: Value,
}

impl Definition {
    /// Definition after a change at the time `now`.
    ///
    /// # Errors
    /// All problems of the change.
    pub fn changed(&self, change: &Change, now: Timestamp) -> Result<Self, Vec<Problem>> {
        let mut new = self.clone();
        let mut problems = Vec::new();
        new.name = change.name.clone().unwrap_or(new.name);
        new.description = change.description.clone().unwrap_or(new.description);
        if let Some(text) = &change.terms
            && new.terms.as_ref().is_none_or(|terms| terms.text != *text)
        {
            let version = new.terms.map_or(1, |terms| terms.version + 1);
            new.terms = Some(Terms { version, text: text.clone() });
        }
        if let Some(to) = change.closes_at {
            let found = extend("closes_at".to_owned(), &mut new.closes_at, to);
            problems.extend(found);
            for window in new.attempts.iter_mut().filter(|of| of.closes_at == self.closes_at) {
                window.closes_at = new.closes_at;
            }
        }
        for (place, (attempt, to)) in change.windows.iter().enumerate() {
            let own = (*attempt as usize).checked_sub(1);
            let window = own.and_then(|own| new.attempts.get_mut(own));
            problems.extend(if let Some(window) = window {
                let field = format!("attempts[{place}].closes_at");
                // Entrants read their games once the window has closed; others would still play on these seeds.
                if self.own_games == OwnGames::Ended && window.closes_at <= now {
                    let closed = window.closes_at;
                    let problem = format!("cannot be moved: the window closed at {closed}, and entrants read their games since");
                    Some((field, problem))
                } else {
                    extend(field, &mut window.closes_at, *to)
                }
            } else {
                let count = self.attempts.len();
                let problem = format!("must be from 1 to {count}, is {attempt}");
                Some((format!("attempts[{place}].attempt"), problem))
            });
        }
        problems.extend(new.problems(now).into_iter().filter(|(field, _)| {
            ["name", "description", "closes_at", "terms"].contains(&field.as_str())
                || field.starts_with("attempts")
        }));
        if problems.is_empty() { Ok(new) } else { Err(problems) }
    }

    /// Fields in which another definition of the same competition differs.
    #[must_use]
    pub fn differences(&self, new: &Self) -> Vec<Changed> {
        let texts =
            [("name", &self.name, &new.name), ("description", &self.description, &new.description)];
        let texts = texts.map(|(field, from, to)| (field.to_owned(), json!(from), json!(to)));
        let terms = ("terms".to_owned(), json!(self.terms), json!(new.terms));
        let end = ("closes_at".to_owned(), json!(self.closes_at), json!(new.closes_at));
        let windows = self.attempts.iter().zip(&new.attempts).enumerate();
        let windows = windows.map(|(place, (from, to))| {
            (end_of_window(place), json!(from.closes_at), json!(to.closes_at))
        });
        let all = texts.into_iter().chain([terms, end]).chain(windows);
        let differ = all.filter(|(_, from, to)| from != to);
        differ.map(|(field, from, to)| Changed { field, from, to }).collect()
    }

    /// Ends that the window of an attempt has had, each with the time from which it was known. The first one was announced.
    #[must_use]
    pub fn ends(
        &self,
        attempt: u32,
        changes: &[(Timestamp, Vec<Changed>)],
    ) -> Vec<(Timestamp, Timestamp)> {
        let own = |field: &str| match self.spare(attempt) {
            Some(_) => field == "closes_at",
            None => {
                (attempt as usize).checked_sub(1).is_some_and(|own| field == end_of_window(own))
            }
        };
        let read = |value: &Value| value.as_str()?.parse().ok();
        let mut ends: Vec<(Timestamp, Timestamp)> = Vec::new();
        for (at, changed) in changes {
            for changed in changed.iter().filter(|changed| own(&changed.field)) {
                if ends.is_empty() {
                    ends.extend(read(&changed.from).map(|from| (Timestamp::MIN, from)));
                }
                ends.extend(read(&changed.to).map(|to| (*at, to)));
            }
        }
        if ends.is_empty() {
            let Window { closes_at, .. } = self
                .window(attempt)
                .unwrap_or(Window { opens_at: self.opens_at, closes_at: self.closes_at });
            ends.push((Timestamp::MIN, closes_at));
        }
        ends
    }
}

/// Moves an end to a later time.
fn extend(field: String, end: &mut Timestamp, to: Timestamp) -> Option<Problem> {
    if to < *end {
        let problem = format!(
            "must not be before {end}, when it ends now: a window is extended, never shortened"
        );
        return Some((field, problem));
    }
    *end = to;
    None
}

fn end_of_window(place: usize) -> String {
    format!("attempts[{place}].closes_at")
}

#[cfg(test)]
mod tests {
    use super::super::definition::tests::{at, definition};
    use super::*;

    fn fields(problems: Vec<Problem>) -> Vec<String> {
        problems.into_iter().map(|(field, _)| field).collect()
    }

    #[test]
    fn windows_are_extended_and_never_shortened() {
        let mut old = definition();
        old.attempts[0].closes_at = at(50);
        let change =
            Change { closes_at: Some(at(120)), windows: vec![(1, at(60))], ..Change::default() };
        let new = old.changed(&change, at(55)).expect("a change");
        let ends: Vec<_> = new.attempts.iter().map(|window| window.closes_at).collect();
        assert_eq!((new.closes_at, ends), (at(120), vec![at(60), at(120)]));
        let changed: Vec<_> = old.differences(&new).into_iter().map(|of| of.field).collect();
        assert_eq!(changed, ["closes_at", "attempts[0].closes_at", "attempts[1].closes_at"]);
        let changes = [(at(55), old.differences(&new))];
        assert_eq!(new.ends(1, &changes), [(Timestamp::MIN, at(50)), (at(55), at(60))]);
        assert_eq!(new.ends(2, &changes), [(Timestamp::MIN, at(100)), (at(55), at(120))]);
        assert_eq!(old.ends(1, &[]), [(Timestamp::MIN, at(50))]);

        let shorter = Change {
            closes_at: Some(at(99)),
            windows: vec![(1, at(49)), (3, at(60))],
            ..Change::default()
        };
        let problems = old.changed(&shorter, at(20)).expect_err("it is shorter");
        assert_eq!(fields(problems), ["closes_at", "attempts[0].closes_at", "attempts[1].attempt"]);
        let outside = Change { windows: vec![(1, at(101))], ..Change::default() };
        assert_eq!(
            fields(old.changed(&outside, at(20)).expect_err("it ends later")),
            ["attempts[0].closes_at"]
        );
    }

    #[test]
    fn a_window_whose_games_are_open_to_entrants_stays_closed() {
        let mut old = definition();
        old.attempts[0].closes_at = at(50);
        let change = Change { windows: vec![(1, at(60))], ..Change::default() };
        assert!(old.changed(&change, at(50)).is_ok(), "nobody has read a game");
        old.own_games = OwnGames::Ended;
        assert!(old.changed(&change, at(49)).is_ok());
        let problems = old.changed(&change, at(50)).expect_err("entrants read their games");
        assert_eq!(fields(problems), ["attempts[0].closes_at"]);
    }

    #[test]
    fn texts_are_corrected_and_checked() {
        let old = definition();
        let change = |name: &str| Change { name: Some(name.to_owned()), ..Change::default() };
        let new = old.changed(&change("another cup"), at(0)).expect("a change");
        let differences = old.differences(&new);
        assert_eq!(differences.len(), 1);
        assert_eq!((&*differences[0].field, &differences[0].to), ("name", &json!("another cup")));
        assert_eq!(fields(old.changed(&change(""), at(0)).expect_err("no name")), ["name"]);
        assert_eq!(old.changed(&Change::default(), at(0)), Ok(old.clone()));
        assert_eq!(old.differences(&old), []);
    }
}
