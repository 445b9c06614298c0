//! The options that say how messages are turned into vectors.

use std::path::PathBuf;
use std::str::FromStr;
use std::sync::Arc;

use anyhow::bail;
use swarmbench_analysis::{Embedder, Hash1};
use tokio_util::sync::CancellationToken;

use super::asked_to_stop;
use super::options::{KEY_VARIABLE, api_base, api_key};
use super::output::{progress_bar, set};
use swarmbench_client::embed::{BATCHES_AT_ONCE, Embeddings, Error, VectorFile};
use swarmbench_client::llm::{Allowance, Settings};
use swarmbench_clock::SystemClock;

/// Characters of the name of a model: it is part of every value that is computed with it.
const MODEL_CHARS_MAX: usize = 200;

#[derive(Clone, Debug, clap::Args)]
pub(super) struct EmbedderArgs {
    /// How messages are turned into vectors: hash-1 works offline, endpoint:MODEL asks a model at an endpoint.
    #[arg(long, value_name = "hash-1|endpoint:MODEL", default_value = "hash-1")]
    embedder: Name,
    #[arg(
        long,
        value_name = "URL",
        help = "The endpoint, up to /embeddings, such as http://127.0.0.1:8080/v1 [env: OPENAI_BASE_URL]"
    )]
    embedder_url: Option<String>,
    #[arg(
        long,
        value_name = "NAME",
        help = "The environment variable that holds its key (OPENAI_API_KEY)"
    )]
    embedder_key_env: Option<String>,
    /// Keep all vectors in this file, a recording that can be played; those that are in it already are taken from there.
    #[arg(
        long,
        visible_alias = "embedder-record",
        value_name = "FILE",
        conflicts_with = "embedder_play"
    )]
    embedder_cache: Option<PathBuf>,
    /// Take all vectors from this recording, and ask no endpoint.
    #[arg(long, value_name = "FILE")]
    embedder_play: Option<PathBuf>,
}

/// The id of an embedder.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Name {
    Hash1,
    Endpoint(String),
}

impl FromStr for Name {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let model = match (text, text.strip_prefix("endpoint:")) {
            ("hash-1", _) => return Ok(Self::Hash1),
            (_, Some(model)) => model,
            (_, None) => {
                return Err("it is hash-1, or endpoint:MODEL, such as endpoint:all-mpnet-base-v2"
                    .to_owned());
            }
        };
        let is_name = !model.trim().is_empty() && !model.contains(char::is_control);
        if is_name && model.chars().count() <= MODEL_CHARS_MAX {
            Ok(Self::Endpoint(model.to_owned()))
        } else {
            Err(format!(
                "after endpoint: comes the name of a model, of 1 to {MODEL_CHARS_MAX} characters"
            ))
        }
    }
}

/// What turns messages into vectors.
#[derive(Debug)]
pub(super) enum Choice {
    /// The embedder of the binary.
    Hash1,
    /// A model at an endpoint, or its recording.
    Endpoint(Box<Embeddings>),
}

impl EmbedderArgs {
    /// Whether it is the embedder of the binary, whose values servers store.
    pub(super) fn is_default(&self) -> bool {
        self.embedder == Name::Hash1
    }

    /// Opens the embedder. All that can be checked without asking the endpoint is checked.
    pub(super) fn open(&self) -> anyhow::Result<Choice> {
        let model = match &self.embedder {
            Name::Endpoint(model) => model,
            Name::Hash1 => {
                let others = [
                    ("--embedder-url", self.embedder_url.is_some()),
                    ("--embedder-key-env", self.embedder_key_env.is_some()),
                    ("--embedder-cache", self.embedder_cache.is_some()),
                    ("--embedder-play", self.embedder_play.is_some()),
                ];
                return match others.iter().find(|(_, is_given)| *is_given) {
                    None => Ok(Choice::Hash1),
                    Some((option, _)) => bail!(
                        "{option} is for a model: name it with --embedder endpoint:MODEL, or leave {option} out"
                    ),
                };
            }
        };
        let file = match (&self.embedder_cache, &self.embedder_play) {
            (Some(path), _) => Some(VectorFile::record(path)?),
            (None, Some(path)) => Some(VectorFile::play(path)?),
            (None, None) => None,
        };
        if let Some(file) = file.as_ref().filter(|file| file.damaged() > 0) {
            let (path, damaged) = (file.path().display(), file.damaged());
            note!("{path}: {damaged} damaged lines are left out; their texts have no vector in it");
        }
        let embeddings = match file {
            Some(file) if self.embedder_play.is_some() => Embeddings::played(model.clone(), file),
            file => {
                let base = api_base(self.embedder_url.as_deref(), model, "--embedder-url")?;
                let key = api_key(
                    self.embedder_key_env.as_deref(),
                    KEY_VARIABLE,
                    model,
                    "--embedder-key-env",
                )?;
                let allowance = Allowance::new(BATCHES_AT_ONCE, None, Arc::new(SystemClock));
                Embeddings::new(Settings::new(model, base, key), &allowance, file)?
            }
        };
        Ok(Choice::Endpoint(Box::new(embeddings)))
    }
}

impl Choice {
    /// The vectors of these texts. Ctrl-C cancels; vectors that had come are in the cache.
    pub(super) async fn of_texts(
        &self,
        texts: impl IntoIterator<Item = String>,
    ) -> anyhow::Result<Arc<dyn Embedder>> {
        let embeddings = match self {
            Self::Hash1 => return Ok(Arc::new(Hash1::new())),
            Self::Endpoint(embeddings) => embeddings,
        };
        let bar = progress_bar("{bar:30} {pos} of {len} texts have vectors, {eta} left");
        let never = CancellationToken::new();
        let show = |done: usize, of: usize| set(&bar, done as u64, of as u64);
        let vectors = tokio::select! {
            vectors = embeddings.vectors(texts, show, &never) => vectors,
            () = asked_to_stop() => bail!("{}", Error::Cancelled),
        };
        bar.finish_and_clear();
        Ok(Arc::new(vectors?))
    }
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Debug, Parser)]
    struct Command {
        #[command(flatten)]
        embedder: EmbedderArgs,
    }

    fn open(args: &[&str]) -> anyhow::Result<Choice> {
        Command::try_parse_from([&["metrics"], args].concat())?.embedder.open()
    }

    #[test]
    fn the_default_is_offline_and_a_model_has_its_id() {
        assert!(matches!(open(&[]).expect("good options"), Choice::Hash1));
        let args =
            ["--embedder", "endpoint:sentence/m:1", "--embedder-url", "http://127.0.0.1:9/v1"];
        let Choice::Endpoint(embeddings) = open(&args).expect("good options") else {
            panic!("a model")
        };
        assert_eq!(embeddings.id(), "endpoint:sentence/m:1");
    }

    #[test]
    fn what_cannot_work_says_what_to_do() {
        let folder = tempfile::tempdir().expect("a folder");
        let text = |path: PathBuf| path.to_str().expect("UTF-8").to_owned();
        let (cache, nothing) =
            (text(folder.path().join("cache")), text(folder.path().join("nothing")));
        let model = ["--embedder", "endpoint:m", "--embedder-url", "http://127.0.0.1:9/v1"];
        for (args, words) in [
            (vec!["--embedder", "mpnet"], "it is hash-1, or endpoint:MODEL"),
            (vec!["--embedder", "endpoint:"], "comes the name of a model"),
            (vec!["--embedder-cache", &cache], "--embedder endpoint:MODEL"),
            (
                vec!["--embedder", "endpoint:m", "--embedder-url", "nowhere"],
                "no address of a server",
            ),
            ([&model[..], &["--embedder-key-env", "NO_SUCH_KEY"]].concat(), "--embedder-key-env"),
            ([&model[..], &["--embedder-play", &nothing]].concat(), "No such file"),
            (
                [&model[..], &["--embedder-record", &cache, "--embedder-play", &cache]].concat(),
                "cannot be used with",
            ),
        ] {
            let error = open(&args).expect_err("it cannot work").to_string();
            assert!(error.contains(words), "{args:?}: {error}");
        }
    }
}
