//! What an endpoint is asked for.

/// A route of an endpoint. Errors name the options of the commands that use it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Route {
    /// Chat completions, for `swarmbench eval`.
    Chat,
    /// Messages of Anthropic, for `swarmbench eval`.
    Messages,
    /// Vectors of texts, for `swarmbench metrics`.
    Embeddings,
}

impl Route {
    /// What follows the address of the endpoint.
    pub(super) const fn path(self) -> &'static str {
        match self {
            Self::Chat => "/chat/completions",
            Self::Messages => "/messages",
            Self::Embeddings => "/embeddings",
        }
    }

    /// The name of a good answer.
    pub(super) const fn answer(self) -> &'static str {
        match self {
            Self::Chat => "chat completion",
            Self::Messages => "message",
            Self::Embeddings => "list of embeddings",
        }
    }

    pub(super) const fn address_option(self) -> &'static str {
        match self {
            Self::Chat | Self::Messages => "--api-base",
            Self::Embeddings => "--embedder-url",
        }
    }

    pub(super) const fn key_option(self) -> &'static str {
        match self {
            Self::Chat | Self::Messages => "--api-key-env",
            Self::Embeddings => "--embedder-key-env",
        }
    }

    /// What remains after requests were given up.
    pub(super) const fn kept(self) -> &'static str {
        match self {
            Self::Chat | Self::Messages => "No move was lost",
            Self::Embeddings => "Vectors that came before are in the cache, if there is one",
        }
    }

    /// How to wait for longer, after "run the same command again then".
    pub(super) const fn longer_pauses(self) -> &'static str {
        match self {
            Self::Chat | Self::Messages => ", or allow longer pauses with --patience",
            Self::Embeddings => "",
        }
    }
}
