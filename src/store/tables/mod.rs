//! Queries, one file a table.

/// The competition of a run `r`: that of its attempt, or the one for which its owner's key was made.
macro_rules! competition_of_run {
    () => {
        "coalesce(r.competition, (SELECT n.competition FROM keys k JOIN entries n ON n.owner = k.number
                                  WHERE k.number = r.owner AND k.role = 'entrant' ORDER BY n.key LIMIT 1))"
    };
}

pub mod audit;
pub mod clock;
pub mod competitions;
pub mod episodes;
pub mod exports;
pub(in crate::store) mod forks;
pub mod games;
pub mod imports;
pub mod journals;
pub mod keys;
pub mod metrics;
pub mod records;
pub mod results;
pub mod runs;
pub mod seats;
pub(in crate::store) mod templates;
pub mod tokens;
