//! Vectors of texts from any endpoint with the usual `POST /v1/embeddings`.
//!
//! [`Embeddings`] asks the endpoint in batches, with the limits, retries and errors of [`crate::llm`], and gives
//! [`Vectors`]: a [`swarmbench_analysis::Embedder`] for a known set of texts. A [`VectorFile`] keeps all vectors that came:
//! no text is paid for twice, and with [`Embeddings::played`] the same texts have the same vectors without any endpoint.
//!
//! Components are kept as 32-bit floats, as models compute them, and vectors are brought to length 1 in 64 bits. So a
//! vector from the file has the bits of the one that came from the endpoint.

mod batch;
mod file;

use std::collections::{HashMap, HashSet};
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock};

use futures::StreamExt;
use futures::stream;
use swarmbench_analysis::Embedder;
use tokio_util::sync::CancellationToken;

use crate::llm::stop::Said;
use crate::llm::{Allowance, Requests, Route, Settings, Spent, Stop};
use batch::{Batch, Reply, Vector};

pub use batch::Flaw;
pub use file::{VECTORS_MAX, VectorFile};

/// Texts of one request: as many as text-embeddings-inference takes unless it is told otherwise.
pub const BATCH_TEXTS_MAX: usize = 32;

/// Requests of one call that are in flight at once.
pub const BATCHES_AT_ONCE: usize = 4;

/// Bytes that the vectors of one call may take in memory.
pub const VECTOR_BYTES_MAX: usize = 1 << 30;

/// Why texts have no vectors. `Display` is for people: what happened, and what to do next. Texts are numbered from 1, in
/// the order in which each came first. No key is ever in it.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Error {
    /// The endpoint cannot be had, or a setting cannot work.
    #[error(transparent)]
    Stop(#[from] Stop),
    /// The endpoint refuses a text that was sent alone.
    #[error(
        "{url} refuses text {text} of {of} ({status}): see whether it is too long for {model} (some servers cut long texts on \
         request, as text-embeddings-inference with --auto-truncate), and whether the endpoint serves a model of this name. \
         {said}"
    )]
    Refused {
        /// What was asked.
        url: String,
        /// Which model.
        model: String,
        /// The number of the text.
        text: usize,
        /// How many different texts there are.
        of: usize,
        /// The status.
        status: u16,
        /// What the endpoint said.
        said: Said,
    },
    /// What came for a text is no vector that could be compared.
    #[error(
        "text {text} of {of} has no vector of {model} that could be compared: {flaw}. See whether the endpoint serves an \
         embedding model under this name; if the model was exchanged, use another file for its vectors"
    )]
    Vector {
        /// Which model.
        model: String,
        /// The number of the text.
        text: usize,
        /// How many different texts there are.
        of: usize,
        /// What is wrong with it.
        flaw: Flaw,
    },
    /// The vectors would take more memory than they may.
    #[error(
        "{texts} texts of {dimensions} dimensions need more than the {VECTOR_BYTES_MAX} bytes that vectors may take: \
         measure fewer games at once"
    )]
    TooMany {
        /// How many different texts there are.
        texts: usize,
        /// How long the vectors are.
        dimensions: usize,
    },
    /// The file that replaces the endpoint lacks a text.
    #[error(
        "{}: it has no vector of {model} for text {text} of {of}; these are not the texts that were recorded, or the \
         recording was interrupted: record more by asking the endpoint",
        path.display()
    )]
    NotRecorded {
        /// The file.
        path: PathBuf,
        /// Which model.
        model: String,
        /// The number of the text.
        text: usize,
        /// How many different texts there are.
        of: usize,
    },
    /// The file of vectors cannot be read or written.
    #[error("the vectors in {}: {what}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        what: String,
    },
    /// It was cancelled. Vectors that had come are in the file.
    #[error("cancelled; vectors that had come are in the cache, if there is one")]
    Cancelled,
}

/// A model that turns texts into vectors.
#[derive(Debug)]
pub struct Embeddings {
    model: String,
    id: String,
    /// `None` if the file alone answers.
    requests: Option<Requests>,
    file: Option<Mutex<VectorFile>>,
    /// The length of all vectors, once one is known.
    dimensions: OnceLock<usize>,
    /// How many texts a request may have, as far as is known.
    batch_texts: AtomicUsize,
}

impl Embeddings {
    /// A model at an endpoint, within an allowance. What is in the file is taken from there; what is not is asked and
    /// added.
    ///
    /// # Errors
    /// [`Stop::Settings`] where a setting cannot work: settings with a sampling or further fields too, as the id of an
    /// embedder names its model alone.
    pub fn new(
        settings: Settings,
        allowance: &Allowance,
        file: Option<VectorFile>,
    ) -> Result<Self, Stop> {
        let requests = Requests::new(settings, Route::Embeddings, allowance)?;
        if let Some(name) = requests.body().keys().find(|name| *name != "model") {
            return Err(Stop::Settings(format!(
                "requests for vectors have no field {name:?}: two settings of a model would have the same id"
            )));
        }
        let model = requests.settings().model.clone();
        Ok(Self::with(model, Some(requests), file))
    }

    /// A model whose vectors are all in a file: no endpoint is ever asked.
    #[must_use]
    pub fn played(model: String, file: VectorFile) -> Self {
        Self::with(model, None, Some(file))
    }

    fn with(model: String, requests: Option<Requests>, file: Option<VectorFile>) -> Self {
        Self {
            id: format!("endpoint:{model}"),
            model,
            requests,
            file: file.map(Mutex::new),
            dimensions: OnceLock::new(),
            batch_texts: AtomicUsize::new(BATCH_TEXTS_MAX),
        }
    }

    /// The id of the embedder: `endpoint:` and the name of the model.
    #[must_use]
    pub fn id(&self) -> &str {
        &self.id
    }

    /// What was asked and spent so far; nothing where a file alone answers.
    #[must_use]
    pub fn spent(&self) -> Spent {
        self.requests.as_ref().map(|requests| requests.counters.spent()).unwrap_or_default()
    }

    /// The vectors of texts; each text is asked for once, however often it occurs. `progress` is called with the number
    /// of texts that have their vectors, and the number of different texts. Dropping the future cancels it as well as the
    /// token does.
    ///
    /// # Errors
    /// See [`Error`]. What had come by then is in the file.
    pub async fn vectors(
        &self,
        texts: impl IntoIterator<Item = String>,
        progress: impl Fn(usize, usize),
        cancel: &CancellationToken,
    ) -> Result<Vectors, Error> {
        let mut seen = HashSet::new();
        let texts: Vec<String> =
            texts.into_iter().filter(|text| seen.insert(text.clone())).collect();
        drop(seen);
        let mut vectors = HashMap::new();
        let mut missing = Vec::new();
        for (at, text) in texts.iter().enumerate() {
            if cancel.is_cancelled() {
                return Err(Error::Cancelled);
            }
            match self.kept(text)? {
                Some(vector) => {
                    vectors.insert(text.clone(), self.checked(&vector, at, texts.len())?);
                }
                None => missing.push(at),
            }
        }
        progress(vectors.len(), texts.len());
        if let Some(first) = missing.first() {
            let requests = self.requests.as_ref();
            let requests = requests.ok_or_else(|| self.not_recorded(*first, texts.len()))?;
            // Each batch owns its numbers: a future that borrows them could not be sent to another thread.
            let batches: Vec<_> = missing.chunks(BATCH_TEXTS_MAX).map(<[usize]>::to_vec).collect();
            let batches = batches.into_iter().map(|batch| self.batch(requests, &texts, batch));
            let mut batches = stream::iter(batches).buffer_unordered(BATCHES_AT_ONCE);
            loop {
                let batch = tokio::select! {
                    biased;
                    () = cancel.cancelled() => return Err(Error::Cancelled),
                    batch = batches.next() => batch,
                };
                let Some(batch) = batch else { break };
                vectors.extend(batch?);
                progress(vectors.len(), texts.len());
            }
        }
        Ok(Vectors { id: self.id.clone(), vectors })
    }

    /// Asks for the texts at some places. A batch that is refused is halved, and no later one is larger.
    async fn batch(
        &self,
        requests: &Requests,
        texts: &[String],
        batch: Vec<usize>,
    ) -> Result<Vec<(String, Arc<[f64]>)>, Error> {
        let of = texts.len();
        let mut came = Vec::with_capacity(batch.len());
        let mut rest = vec![batch];
        while let Some(mut part) = rest.pop() {
            let most = self.batch_texts.load(Ordering::Relaxed);
            if part.len() > most {
                rest.push(part.split_off(most));
            }
            let request = Batch { texts: part.iter().map(|at| texts[*at].as_str()).collect() };
            match requests.send(&request).await?.answer {
                Reply::Refused { .. } if part.len() > 1 => {
                    self.batch_texts.fetch_min(part.len().div_ceil(2), Ordering::Relaxed);
                    rest.push(part);
                }
                Reply::Refused { status, said } => {
                    let (url, model) = (requests.url().to_owned(), self.model.clone());
                    let text = part[0] + 1;
                    return Err(Error::Refused { url, model, text, of, status, said });
                }
                Reply::Vectors { vectors, usage, tokens } => {
                    requests.counters.answered(&usage, tokens.is_none(), None);
                    let vectors = vectors.map_err(|(i, flaw)| self.flawed(part[i], of, flaw))?;
                    for (at, vector) in part.into_iter().zip(vectors) {
                        let checked = self.checked(&vector, at, of)?;
                        self.keep(&texts[at], &vector)?;
                        came.push((texts[at].clone(), checked));
                    }
                }
            }
        }
        Ok(came)
    }

    /// The vector of length 1.
    fn checked(&self, vector: &Vector, at: usize, of: usize) -> Result<Arc<[f64]>, Error> {
        let flawed = |flaw| self.flawed(at, of, flaw);
        let unit = batch::unit(vector).map_err(flawed)?;
        let (expected, came) = (*self.dimensions.get_or_init(|| unit.len()), unit.len());
        if expected != came {
            return Err(flawed(Flaw::Dimensions { expected, came }));
        }
        if of.saturating_mul(came) > VECTOR_BYTES_MAX / size_of::<f64>() {
            return Err(Error::TooMany { texts: of, dimensions: came });
        }
        Ok(unit)
    }

    fn flawed(&self, at: usize, of: usize, flaw: Flaw) -> Error {
        Error::Vector { model: self.model.clone(), text: at + 1, of, flaw }
    }

    fn file(&self) -> Option<MutexGuard<'_, VectorFile>> {
        self.file.as_ref().map(|file| file.lock().expect("nothing panics while it holds this"))
    }

    fn kept(&self, text: &str) -> Result<Option<Vector>, Error> {
        self.file().map_or(Ok(None), |mut file| file.find(&self.id, text))
    }

    fn keep(&self, text: &str, vector: &Vector) -> Result<(), Error> {
        self.file().map_or(Ok(()), |mut file| file.add(&self.id, text, vector))
    }

    fn not_recorded(&self, at: usize, of: usize) -> Error {
        let path = self.file().map(|file| file.path().to_owned()).unwrap_or_default();
        Error::NotRecorded { path, model: self.model.clone(), text: at + 1, of }
    }
}

/// The vectors of some texts, all of Euclidean length 1.
#[derive(Clone, Debug, PartialEq)]
pub struct Vectors {
    id: String,
    vectors: HashMap<String, Arc<[f64]>>,
}

impl Embedder for Vectors {
    fn id(&self) -> &str {
        &self.id
    }

    fn vector(&self, text: &str) -> Option<Arc<[f64]>> {
        self.vectors.get(text).cloned()
    }
}
