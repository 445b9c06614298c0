//! Requests at once, and tokens in all.

use futures::future::join_all;
use serde_json::json;
use swarmbench_client::llm::Stop;

use crate::llm::endpoint::{Endpoint, Reply, completion};
use crate::llm::time::Leaps;
use crate::llm::{Bench, ask, question};

#[tokio::test]
async fn so_many_requests_are_in_flight_and_no_more() {
    let endpoint =
        Endpoint::start(|number, _| Reply::says("ACTION: UP").held_until(usize::from(number < 3)))
            .await;
    let mut bench = Bench::with(&endpoint, Leaps::leaping(), 3, None);
    let first = bench.model();
    bench.settings.model = "swarm-2".to_owned();
    let second = bench.model();
    let models = [&first, &second];
    let asked: Vec<_> =
        (0..20).map(|agent| ask(models[agent as usize % 2], question(agent, 0))).collect();
    endpoint.has_seen(3).await;
    assert_eq!(first.spent().in_flight + second.spent().in_flight, 3);
    endpoint.release();
    for asked in asked {
        asked.await.expect("no panic").expect("an answer");
    }
    assert_eq!((endpoint.most_at_once(), endpoint.seen().len()), (3, 20));
    assert_eq!(first.spent().in_flight + second.spent().in_flight, 0);
}

#[tokio::test]
async fn who_asks_first_is_asked_first() {
    let endpoint = Endpoint::replies(vec![]).await;
    let bench = Bench::with(&endpoint, Leaps::leaping(), 1, None);
    let model = bench.model();
    let questions: Vec<_> = (0..20).map(|agent| question(agent, 0)).collect();
    let answers = join_all(questions.iter().map(|question| model.answer(question))).await;
    assert!(answers.iter().all(Result::is_ok));
    let seen = endpoint.seen();
    let prompts: Vec<_> = seen.iter().map(crate::llm::endpoint::Seen::prompt).collect();
    assert_eq!(
        prompts,
        questions.iter().map(|question| question.prompt.as_str()).collect::<Vec<_>>()
    );
}

#[tokio::test]
async fn a_question_that_is_given_up_frees_its_place() {
    let endpoint = Endpoint::replies(vec![Reply::says("ACTION: UP").held_until(1)]).await;
    let bench = Bench::with(&endpoint, Leaps::leaping(), 1, None);
    let model = bench.model();
    let asked = ask(&model, question(0, 0));
    endpoint.has_seen(1).await;
    asked.abort();
    asked.await.expect_err("it was given up");
    assert_eq!(model.spent().in_flight, 0);
    model.answer(&question(1, 0)).await.expect("an answer");
}

#[tokio::test]
async fn nothing_is_begun_once_the_budget_is_spent() {
    let endpoint = Endpoint::replies(vec![]).await;
    let mut bench = Bench::with(&endpoint, Leaps::leaping(), 4, Some(31));
    let first = bench.model();
    bench.settings.model = "swarm-2".to_owned();
    let second = bench.model();
    // Each answer takes 15 tokens, whichever model gives it.
    for (model, spent) in [(&first, 15), (&second, 30), (&first, 45)] {
        model.answer(&question(0, 0)).await.expect("an answer");
        assert_eq!(bench.allowance.spent(), spent);
    }
    for model in [&first, &second] {
        let stop = model.answer(&question(0, 0)).await.expect_err("it is spent");
        assert_eq!(stop, Stop::BudgetSpent { spent: 45, budget: 31 });
        assert!(stop.to_string().contains("45 of 31 tokens"), "{stop}");
        assert!(stop.to_string().contains("larger budget"), "{stop}");
    }
    assert_eq!(endpoint.seen().len(), 3);
    assert_eq!(bench.allowance.budget(), Some(31));
}

#[tokio::test]
async fn what_is_in_flight_when_the_budget_is_spent_is_finished() {
    let endpoint = Endpoint::start(|_, _| Reply::says("ACTION: UP").held_until(1)).await;
    let bench = Bench::with(&endpoint, Leaps::leaping(), 4, Some(1));
    let model = bench.model();
    let asked: Vec<_> = (0..10).map(|agent| ask(&model, question(agent, 0))).collect();
    endpoint.has_seen(4).await;
    endpoint.release();
    let (mut answers, mut stops) = (0, 0);
    for asked in asked {
        match asked.await.expect("no panic") {
            Ok(answer) => {
                assert_eq!(answer.response, "ACTION: UP");
                answers += 1;
            }
            Err(Stop::BudgetSpent { spent, budget: 1 }) => {
                assert!(spent >= 15);
                stops += 1;
            }
            Err(stop) => panic!("{stop}"),
        }
    }
    assert_eq!((answers, stops, endpoint.seen().len()), (4, 6, 4));
}

#[tokio::test]
async fn a_retry_is_a_request_too() {
    let endpoint = Endpoint::replies(vec![Reply::error(500, "oops")]).await;
    let bench = Bench::with(&endpoint, Leaps::standing(), 1, Some(15));
    let model = bench.model();
    let pausing = ask(&model, question(0, 0));
    bench.clock.has_seen(1).await;
    model.answer(&question(1, 0)).await.expect("an answer");
    bench.clock.pass(std::time::Duration::from_secs(2));
    let stop = pausing.await.expect("no panic").expect_err("it is spent");
    assert_eq!(stop, Stop::BudgetSpent { spent: 15, budget: 15 });
    assert_eq!(endpoint.seen().len(), 2);
}

#[tokio::test]
async fn where_nobody_tells_what_it_costs_four_bytes_are_a_token() {
    let mut body = completion(&json!({ "content": "ACTION: UP", "reasoning": "hm" }), "stop");
    body["usage"].take();
    let endpoint = Endpoint::start(move |_, _| Reply::json(200, &body)).await;
    let bench = Bench::new(&endpoint);
    let model = bench.model();
    let answer = model.answer(&question(0, 0)).await.expect("an answer");
    assert_eq!((answer.usage.prompt_tokens, answer.usage.completion_tokens), (None, None));
    let bytes = question(0, 0).prompt.len() + "ACTION: UP".len() + "hm".len();
    assert_eq!(bench.allowance.spent(), bytes.div_ceil(4) as u64);
    let spent = model.spent();
    assert_eq!((spent.unmetered, spent.prompt_tokens, spent.completion_tokens), (1, 0, 0));
}

#[tokio::test]
async fn thoughts_that_only_the_total_counts_are_paid_for() {
    let mut body = completion(&json!({ "content": "ACTION: UP" }), "stop");
    body["usage"]["total_tokens"] = json!(1000);
    let endpoint = Endpoint::start(move |_, _| Reply::json(200, &body)).await;
    let bench = Bench::new(&endpoint);
    bench.model().answer(&question(0, 0)).await.expect("an answer");
    assert_eq!(bench.allowance.spent(), 1000);
}
