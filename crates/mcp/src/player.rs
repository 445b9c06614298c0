//! The requests of the protocol, answered for one seat.

use std::sync::Arc;
use std::time::Duration;

use rmcp::ErrorData;
use rmcp::handler::server::ServerHandler;
use rmcp::model::{
    CallToolRequestParams, CallToolResponse, CallToolResult, ContentBlock, GetPromptRequestParams,
    GetPromptResponse, GetPromptResult, Implementation, ListPromptsResult, ListResourcesResult,
    ListToolsResult, PaginatedRequestParams, Prompt, PromptMessage, ReadResourceRequestParams,
    ReadResourceResponse, ReadResourceResult, Resource, ResourceContents, Role, ServerCapabilities,
    ServerConfig, Tool, ToolAnnotations,
};
use rmcp::service::{RequestContext, RoleServer};
use serde_json::{Map, Value, json};
use swarmbench_protocol::act::ActRequest;
use swarmbench_protocol::status::Status;
use tokio_util::sync::CancellationToken;

use crate::seen::Seen;
use crate::{MCP_WAIT_S_MAX, Refusal, SeatAccess, arguments, texts};

/// The rules of the game.
const RULES: &str = include_str!("../../../docs/rules.md");

/// The address of the rules.
const RULES_URI: &str = "swarmbench://rules";

/// A service that answers the requests of one client.
#[derive(Clone)]
pub(crate) struct Player {
    seat: Arc<dyn SeatAccess>,
    /// A token that is cancelled when the client is gone: all waits end.
    gone: CancellationToken,
}

impl Player {
    pub(crate) fn new(seat: Arc<dyn SeatAccess>, gone: CancellationToken) -> Self {
        Self { seat, gone }
    }

    async fn call(&self, tool: &str, given: Map<String, Value>) -> CallToolResult {
        let wrong = |problems: String| failed(&texts::arguments(tool, &problems), None);
        match tool {
            "look" => match arguments::look(given) {
                Ok(wait) => self.look(wait).await,
                Err(problems) => wrong(problems),
            },
            _ => match arguments::act(given) {
                Ok((act, wait)) => self.act(act, wait).await,
                Err(problems) => wrong(problems),
            },
        }
    }

    async fn look(&self, wait: Duration) -> CallToolResult {
        match self.wait_for_turn(wait).await {
            Ok(shown) => {
                let structured = shown.json();
                let structured = structured.map(|observation| with(observation, &shown.next()));
                done(shown.blocks(), structured)
            }
            Err(refusal) => refused(&refusal),
        }
    }

    /// Returns the observation once the episode needs an act of this seat, is over, or `wait` has passed.
    async fn wait_for_turn(&self, wait: Duration) -> Result<Shown, Refusal> {
        let shown = self.see(None, Duration::ZERO).await?;
        if wait.is_zero() || shown.seen.facts.is_due() {
            return Ok(shown);
        }
        if shown.seen.facts.status == Status::Waiting {
            return self.wait_for_start(wait).await;
        }
        self.see(Some(shown.seen.facts.round), wait).await
    }

    /// Waits for the start of the episode by polling every second: `GET /obs` only waits for a new round, and a start
    /// is none.
    async fn wait_for_start(&self, wait: Duration) -> Result<Shown, Refusal> {
        let mut left = wait;
        loop {
            let step = left.min(Duration::from_secs(1));
            let shown = self.see(Some(0), step).await?;
            left -= step;
            if left.is_zero() || shown.seen.facts.status != Status::Waiting {
                return Ok(shown);
            }
        }
    }

    async fn see(&self, after: Option<u32>, wait: Duration) -> Result<Shown, Refusal> {
        match self.seat.obs(after, wait, true).await {
            Ok(body) => Ok(Shown { seen: Seen::read(body)?, no_prompt: None }),
            Err(refusal) if refusal.is("template_failed") => {
                let body = self.seat.obs(after, Duration::ZERO, false).await?;
                Ok(Shown { seen: Seen::read(body)?, no_prompt: Some(refusal) })
            }
            Err(refusal) => Err(refusal),
        }
    }

    async fn act(&self, act: ActRequest, wait: Duration) -> CallToolResult {
        let receipt = match self.seat.act(act).await {
            Ok(receipt) => receipt,
            Err(refusal) => return refused(&refusal),
        };
        let mut blocks = vec![ContentBlock::text(texts::receipt(&receipt))];
        let mut structured = json!(receipt);
        // The act counts: its receipt is sent even if the next observation fails.
        match self.see(Some(receipt.round), wait).await {
            Ok(shown) => {
                blocks.extend(shown.blocks());
                structured["obs"] = shown.json().unwrap_or_default();
                done(blocks, Some(with(structured, &shown.next())))
            }
            Err(refusal) => {
                let text = texts::receipt_alone(&refusal);
                structured["obs"] = Value::Null;
                blocks.push(ContentBlock::text(text.clone()));
                done(blocks, Some(with(structured, &text)))
            }
        }
    }
}

/// An observation, and the reason why it has no prompt if that failed.
struct Shown {
    seen: Seen,
    no_prompt: Option<Refusal>,
}

impl Shown {
    fn next(&self) -> String {
        texts::next(&self.seen.facts)
    }

    fn json(&self) -> Option<Value> {
        self.seen.json()
    }

    /// The text of the observation if an act is needed, and the next step.
    fn blocks(&self) -> Vec<ContentBlock> {
        let facts = &self.seen.facts;
        let view = facts.is_due().then(|| match (&facts.prompt, &self.no_prompt) {
            (Some(prompt), _) => prompt.clone(),
            (None, Some(refusal)) => texts::without_prompt(refusal, self.seen.text()),
            (None, None) => self.seen.text().to_owned(),
        });
        view.into_iter().chain([self.next()]).map(ContentBlock::text).collect()
    }
}

/// A structured result with the next step: some clients show their model this and not the text.
fn with(mut object: Value, next: &str) -> Value {
    object["next"] = json!(next);
    object
}

fn done(blocks: Vec<ContentBlock>, structured: Option<Value>) -> CallToolResult {
    let mut result = CallToolResult::success(blocks);
    result.structured_content = structured;
    result
}

/// An error result: text for the model, and the problem for programs.
fn failed(text: &str, refusal: Option<&Refusal>) -> CallToolResult {
    let mut result = CallToolResult::error(vec![ContentBlock::text(text)]);
    if let Some(Refusal::Problem(problem)) = refusal {
        result.structured_content = Some(with(json!(problem), text));
    }
    result
}

fn refused(refusal: &Refusal) -> CallToolResult {
    failed(&texts::refused(refusal), Some(refusal))
}

fn tools() -> Vec<Tool> {
    let wait = |usual: &str| {
        json!({
            "type": "number", "minimum": 0, "maximum": MCP_WAIT_S_MAX,
            "description": format!("Seconds to wait at most, up to {MCP_WAIT_S_MAX}; {usual}.")
        })
    };
    let schema = |properties: Value, required: &[&str]| {
        let schema = json!({
            "type": "object", "properties": properties, "required": required,
            "additionalProperties": false
        });
        let Value::Object(schema) = schema else { unreachable!("it is written as an object") };
        schema
    };
    let usual = ToolAnnotations::new().destructive(false).idempotent(true).open_world(false);
    let look = schema(json!({ "wait_s": wait("0 if left out") }), &[]);
    let act = schema(
        json!({
            "round": {
                "type": "integer", "minimum": 0,
                "description": "The open round, as `look` showed it."
            },
            "action": {
                "type": "string",
                "description": "One of the actions that `look` listed, such as UP or STAY."
            },
            "message": {
                "type": "string",
                "description": "One line to the agents near yours. Of a longer one than 120 characters the rest is cut."
            },
            "to": {
                "type": "string",
                "description": "Only for Agent_0 under centralized control: the one agent that gets the message, such as Agent_3."
            },
            "wait_s": wait("30 if left out"),
        }),
        &["round", "action"],
    );
    vec![
        Tool::new("look", texts::LOOK, look)
            .with_title("Look")
            .with_annotations(usual.clone().read_only(true)),
        Tool::new("act", texts::ACT, act)
            .with_title("Act")
            .with_annotations(usual.read_only(false)),
    ]
}

impl ServerHandler for Player {
    fn get_info(&self) -> ServerConfig {
        let capabilities = ServerCapabilities::builder()
            .enable_tools()
            .enable_resources()
            .enable_prompts()
            .build();
        let about =
            Implementation::new("swarmbench", env!("CARGO_PKG_VERSION")).with_title("swarmbench");
        ServerConfig::new(capabilities)
            .with_server_info(about)
            .with_instructions(texts::INSTRUCTIONS)
    }

    async fn list_tools(
        &self,
        _: Option<PaginatedRequestParams>,
        _: RequestContext<RoleServer>,
    ) -> Result<ListToolsResult, ErrorData> {
        Ok(ListToolsResult::with_all_items(tools()))
    }

    fn get_tool(&self, name: &str) -> Option<Tool> {
        tools().into_iter().find(|tool| tool.name == name)
    }

    async fn call_tool(
        &self,
        request: CallToolRequestParams,
        context: RequestContext<RoleServer>,
    ) -> Result<CallToolResponse, ErrorData> {
        let CallToolRequestParams { name, arguments, .. } = request;
        if self.get_tool(&name).is_none() {
            let shown: String = name.chars().take(40).collect();
            let message = format!("there is no tool {shown:?}; the tools are look and act");
            return Err(ErrorData::invalid_params(message, None));
        }
        let nobody = || Err(ErrorData::internal_error("the client is gone", None));
        tokio::select! {
            result = self.call(&name, arguments.unwrap_or_default()) => Ok(result.into()),
            () = context.ct.cancelled() => nobody(),
            () = self.gone.cancelled() => nobody(),
        }
    }

    async fn list_resources(
        &self,
        _: Option<PaginatedRequestParams>,
        _: RequestContext<RoleServer>,
    ) -> Result<ListResourcesResult, ErrorData> {
        let rules = Resource::new(RULES_URI, "rules")
            .with_title("The rules of the game")
            .with_description("The rules in full, as they are implemented. A player needs no more than what `look` shows.")
            .with_mime_type("text/markdown")
            .with_size(RULES.len() as u64);
        Ok(ListResourcesResult::with_all_items(vec![rules]))
    }

    async fn read_resource(
        &self,
        request: ReadResourceRequestParams,
        _: RequestContext<RoleServer>,
    ) -> Result<ReadResourceResponse, ErrorData> {
        if request.uri != RULES_URI {
            let shown: String = request.uri.chars().take(100).collect();
            let message = format!("there is no resource {shown:?}; there is {RULES_URI}");
            return Err(ErrorData::resource_not_found(message, None));
        }
        let text = ResourceContents::text(RULES, RULES_URI).with_mime_type("text/markdown");
        Ok(ReadResourceResult::new(vec![text]).into())
    }

    async fn list_prompts(
        &self,
        _: Option<PaginatedRequestParams>,
        _: RequestContext<RoleServer>,
    ) -> Result<ListPromptsResult, ErrorData> {
        let play = Prompt::new("play", Some("Play the seat to the end of the game."), None)
            .with_title("Play");
        Ok(ListPromptsResult::with_all_items(vec![play]))
    }

    async fn get_prompt(
        &self,
        request: GetPromptRequestParams,
        _: RequestContext<RoleServer>,
    ) -> Result<GetPromptResponse, ErrorData> {
        if request.name != "play" {
            let shown: String = request.name.chars().take(40).collect();
            let message = format!("there is no prompt {shown:?}; there is play");
            return Err(ErrorData::invalid_params(message, None));
        }
        let play = PromptMessage::new_text(Role::User, texts::PLAY);
        Ok(GetPromptResult::new(vec![play]).into())
    }
}
