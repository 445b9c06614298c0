//! What is asked, and what is made of the answers.

use serde_json::json;

use crate::endpoint::{Endpoint, Reply};
use crate::{Bench, KEY, question};

#[tokio::test]
async fn a_question_is_one_message_with_the_prompt_and_what_was_set() {
    let endpoint = Endpoint::replies(vec![Reply::says("I go up.\nACTION: UP")]).await;
    let mut bench = Bench::new(&endpoint);
    bench.settings.sampling.temperature = Some(0.7);
    bench.settings.sampling.top_p = Some(1.0);
    bench.settings.sampling.max_tokens = Some(900);
    bench.settings.extra.insert("reasoning_effort".to_owned(), json!("low"));
    let answer = bench.model().answer(&question(3, 7)).await.expect("an answer");
    assert_eq!(answer.response, "I go up.\nACTION: UP");
    assert_eq!((answer.usage.prompt_tokens, answer.usage.completion_tokens), (Some(10), Some(5)));
    assert!(answer.usage.latency_ms.is_some());
    assert_eq!((answer.failure, answer.reasoning, answer.retries), (None, None, 0));
    let seen = endpoint.seen();
    assert_eq!(seen.len(), 1);
    assert_eq!(seen[0].uri, "/v1/chat/completions");
    assert_eq!(seen[0].headers["authorization"], format!("Bearer {KEY}"));
    assert_eq!(
        seen[0].body,
        json!({
            "model": "swarm-1",
            "messages": [{ "role": "user", "content": question(3, 7).prompt }],
            "temperature": 0.7,
            "top_p": 1.0,
            "max_tokens": 900,
            "reasoning_effort": "low",
        })
    );
}
