//! Deliveries are the messages that agents see, with their sender and round.

use std::sync::Arc;

use swarmbench_engine::{Act, AgentId, Config, Message, Settings, TaskName, World};

/// The message of agent `sender` in a round.
fn text(sender: AgentId, round: u32) -> String {
    format!("{sender} in round {round}")
}

#[test]
fn deliveries_name_the_sender_and_the_round_of_what_agents_see() {
    for rules in ["paper", "reference"] {
        let rules = rules.to_owned();
        let settings =
            Settings { rules, max_delay: 2, ..Settings::standard(TaskName::Foraging, 27) };
        let config = Config::check(&settings).expect("allowed settings");
        let mut world = World::new(Arc::new(config));
        let (mut own, mut late) = (0, 0);
        for round in 0..10 {
            let say = |agent| Act { message: Message::new(&text(agent, round)), ..Act::default() };
            let acts: Vec<Act> = world.agents().map(say).collect();
            world.step(&acts);
            for delivery in world.heard() {
                assert_eq!(delivery.text.as_str(), text(delivery.sender, delivery.sent));
                own += usize::from(delivery.receiver == delivery.sender);
                late += usize::from(delivery.sent < round);
            }
            for agent in world.agents() {
                let heard = world.heard().filter(|delivery| delivery.receiver == agent);
                let texts: Vec<Message> = heard.map(|delivery| delivery.text.clone()).collect();
                assert_eq!(texts, world.observe(agent).messages);
            }
        }
        assert!(late > 0);
        assert_eq!(own > 0, settings.rules == "reference");
    }
}
