//! `swarmbench mcp`, started and spoken to as an assistant does it.

use std::io::{BufRead as _, BufReader, Write as _};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

use serde_json::{Value, json};

use super::{Serving, swarmbench, text};

/// The command, and what an assistant holds of it.
struct Assistant {
    process: Child,
    /// None once it has hung up.
    to: Option<ChildStdin>,
    from: BufReader<ChildStdout>,
}

impl Assistant {
    /// Starts the command and introduces itself.
    fn start(server: &str, token: Option<&str>) -> Self {
        let mut command = Command::new(swarmbench_testkit::program::program());
        command.args(["mcp", "--server", server]).stdin(Stdio::piped()).stdout(Stdio::piped());
        command.env_remove("SWARMBENCH_TOKEN").stderr(Stdio::null());
        if let Some(token) = token {
            command.env("SWARMBENCH_TOKEN", token);
        }
        let mut process = command.spawn().expect("the binary runs");
        let to = process.stdin.take();
        let from = BufReader::new(process.stdout.take().expect("a pipe"));
        let mut assistant = Self { process, to, from };
        let hello = json!({
            "protocolVersion": "2025-11-25", "capabilities": {},
            "clientInfo": { "name": "a test", "version": "1" },
        });
        let said = assistant.ask("initialize", &hello);
        assert_eq!(said["serverInfo"]["name"], "swarmbench");
        assistant.write(&json!({ "jsonrpc": "2.0", "method": "notifications/initialized" }));
        assistant
    }

    fn write(&mut self, message: &Value) {
        let to = self.to.as_mut().expect("it has not hung up");
        writeln!(to, "{message}").expect("the command reads");
    }

    fn ask(&mut self, method: &str, params: &Value) -> Value {
        self.write(&json!({ "jsonrpc": "2.0", "id": 1, "method": method, "params": params }));
        let mut line = String::new();
        self.from.read_line(&mut line).expect("an answer");
        let answer: Value = serde_json::from_str(&line).expect("one JSON object a line");
        assert!(answer["result"].is_object(), "{answer}");
        answer["result"].clone()
    }

    /// Answer of a tool: true if it failed, and all that a model reads.
    fn tool(&mut self, tool: &str, arguments: &Value) -> (bool, String) {
        let result = self.ask("tools/call", &json!({ "name": tool, "arguments": arguments }));
        let blocks = result["content"].as_array().expect("blocks");
        let texts: Vec<_> =
            blocks.iter().map(|block| block["text"].as_str().expect("a text")).collect();
        (result["isError"] == true, texts.join("\n"))
    }

    /// Hangs up; the command ends by itself.
    fn leave(mut self) {
        drop(self.to.take());
        assert!(self.process.wait().expect("a process").success());
    }
}

impl Drop for Assistant {
    fn drop(&mut self) {
        // It has ended unless the test failed.
        drop(self.process.kill());
        drop(self.process.wait());
    }
}

#[test]
fn an_assistant_plays_a_seat() {
    let folder = tempfile::tempdir().expect("a folder");
    let server = Serving::start(&folder.path().join("mcp.db"), &[]);
    let request = json!({ "task": "Synchronization", "num_agents": 1, "max_round": 3 });
    let created = post(&format!("{}/api/v1/episodes", server.base), &request);
    let token = created["seats"][0]["token"].as_str().expect("a token");
    let mut assistant = Assistant::start(&server.base, Some(token));
    for round in 0..3 {
        let (failed, looked) = assistant.tool("look", &json!({ "wait_s": 45 }));
        assert!(!failed && looked.starts_with("You are Agent_0"), "{looked}");
        assert!(looked.contains(&format!("Round {round} is open")), "{looked}");
        let (failed, refused) = assistant.tool("act", &json!({ "round": round, "action": "JUMP" }));
        assert!(failed && refused.contains("must be one of UP"), "{refused}");
        let (failed, acted) = assistant.tool("act", &json!({ "round": round, "action": "SWITCH" }));
        assert!(
            !failed && acted.starts_with(&format!("Round {round}: SWITCH is recorded.")),
            "{acted}"
        );
    }
    let (_, looked) = assistant.tool("look", &json!({}));
    assert!(
        looked.starts_with("The game is over (finished) after round 3 of 3. The score"),
        "{looked}"
    );
    assistant.leave();
}

#[test]
fn what_is_missing_is_told_to_the_assistant() {
    let mut without_token = Assistant::start("http://127.0.0.1:1", None);
    let (failed, said) = without_token.tool("look", &json!({}));
    assert!(failed && said.contains("SWARMBENCH_TOKEN"), "{said}");
    without_token.leave();
    let mut without_server = Assistant::start("http://127.0.0.1:1", Some("seat_nonsense"));
    let (failed, said) = without_server.tool("act", &json!({ "round": 0, "action": "UP" }));
    assert!(failed && said.contains("`swarmbench serve` starts one"), "{said}");
    without_server.leave();
    let output = swarmbench(&["mcp", "--server", "swarm.example.org"]);
    assert!(
        text(&output.stderr).contains("is not the address of a server"),
        "{}",
        text(&output.stderr)
    );
}

/// Sends JSON, and reads JSON.
fn post(url: &str, body: &Value) -> Value {
    let runtime = tokio::runtime::Runtime::new().expect("a runtime");
    runtime.block_on(async {
        let answer = reqwest::Client::new().post(url).json(body).send().await.expect("an answer");
        answer.json().await.expect("JSON")
    })
}
