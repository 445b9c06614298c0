//! Reads the `/metrics` of a server.

use std::collections::HashMap;

use super::LoadError;
use super::connection::{Connection, Target, request};

/// The samples of one moment; those that differ only in labels are summed.
#[derive(Debug, Default)]
pub(crate) struct Metrics(HashMap<String, f64>);

impl Metrics {
    /// Reads the metrics of a server.
    pub(crate) async fn of(target: &Target) -> Result<Self, LoadError> {
        let mut connection = Connection::new(target);
        let answer = connection.ask(&request(target, "GET", "/metrics", None, None)).await;
        let answer = answer.map_err(|error| LoadError::of("/metrics cannot be read")(&error))?;
        if !answer.is_ok() {
            return Ok(Self::default());
        }
        Ok(Self::parse(&String::from_utf8_lossy(connection.body())))
    }

    fn parse(text: &str) -> Self {
        let mut metrics = Self::default();
        for line in text.lines().filter(|line| !line.starts_with('#')) {
            if let Some((series, value)) = line.rsplit_once(' ')
                && let Ok(value) = value.parse::<f64>()
            {
                let name = series.split('{').next().unwrap_or(series);
                *metrics.0.entry(name.to_owned()).or_insert(0.0) += value;
            }
        }
        metrics
    }

    /// The value of a metric, if the server has it.
    pub(crate) fn get(&self, name: &str) -> Option<f64> {
        self.0.get(name).copied()
    }

    /// The increase of a metric since `before`, where a missing metric counts as zero.
    pub(crate) fn since(&self, before: &Self, name: &str) -> Option<f64> {
        Some(self.get(name)? - before.get(name).unwrap_or_default())
    }

    /// The number of further connections that the server's limit of open files allows, if it reports it.
    pub(crate) fn connections_left(&self) -> Option<usize> {
        let left = self.get("process_max_fds")? - self.get("process_open_fds")? - 100.0;
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a limit that is beyond all counts is none"
        )]
        Some(left.max(0.0) as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn series_of_one_name_are_added_up() {
        let before = Metrics::parse("a_total 1\nb{x=\"1\"} 2\n");
        let text = "# HELP a_total text\n# TYPE a_total counter\na_total 5\nb{x=\"1\"} 2\nb{x=\"2\"} 0.5\n";
        let after = Metrics::parse(text);
        assert_eq!(after.since(&before, "a_total"), Some(4.0));
        assert_eq!(after.get("b"), Some(2.5));
        assert_eq!(after.since(&before, "b"), Some(0.5));
        assert_eq!(after.get("c"), None);
        assert_eq!(after.connections_left(), None);
    }
}
