//! The definition `toolkit`, compared with values that the public toolkit computed (`tests/toolkit/README.md`).

use std::collections::BTreeMap;
use std::fs::{File, read_to_string};
use std::io::BufReader;
use std::path::Path;

use swarmbench_analysis::journal::measure;
use swarmbench_analysis::{Definition, Metric, Options};

/// The toolkit's names of metrics.
const NAMES: [(&str, Metric); 12] = [
    ("prop_question_sentences", Metric::QuestionShare),
    ("prop_digit_chars", Metric::DigitShare),
    ("mean_message_length", Metric::MessageLength),
    ("std_message_length", Metric::MessageLengthStd),
    ("directional_entropy", Metric::DirectionEntropy),
    ("stillness_proportion", Metric::Stillness),
    ("dominant_action_prop", Metric::DominantAction),
    ("polarization_index", Metric::Polarization),
    ("avg_moving_distance", Metric::StepLength),
    ("exploration_rate", Metric::Explored),
    ("local_structure_preservation_count", Metric::KeptPairs),
    ("agent_push_events", Metric::Pushes),
];

#[derive(serde::Deserialize)]
struct Published {
    metrics: BTreeMap<String, Vec<f64>>,
}

#[test]
fn every_frame_of_every_metric_is_that_of_the_toolkit() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/toolkit");
    for game in 0..7 {
        let journal = File::open(folder.join(format!("game-{game}.jsonl"))).expect("a journal");
        let options = Options { series: true, vectors: true, edits: false };
        let (_, metrics) =
            measure(BufReader::new(journal), options, |_, _| ()).expect("it verifies");
        let published = read_to_string(folder.join(format!("toolkit-{game}.json")));
        let published: Published =
            serde_json::from_str(&published.expect("its values")).expect("they are JSON");
        for (name, metric) in NAMES {
            let expected = &published.metrics[name];
            let own = &metrics.series[&(Definition::Toolkit, metric)];
            assert_eq!(own.len(), expected.len(), "{name} of game {game}");
            for (frame, (own, expected)) in own.iter().zip(expected).enumerate() {
                let own = own.expect("the toolkit defines it everywhere");
                assert!(
                    is_close(own, *expected),
                    "{name}, game {game}, frame {frame}: {own} {expected}"
                );
            }
            let frames = &expected[..expected.len() - 1];
            let mean = frames.iter().sum::<f64>() / f64::from(metrics.rounds);
            let value = metrics.value(Definition::Toolkit, metric);
            assert_eq!(value.rounds, metrics.rounds, "{name} of game {game}");
            assert!(is_close(value.value.expect("a mean"), mean), "{name} of game {game}");
        }
    }
}

fn is_close(own: f64, expected: f64) -> bool {
    (own - expected).abs() <= 1e-12 * expected.abs().max(own.abs())
}
