//! No template overflows a stack, whether it is refused or at the limits.

use std::sync::Arc;

use swarmbench_engine::{AgentId, Config, Settings, TaskName, World};
use swarmbench_prompt::{
    TEMPLATE_BYTES_MAX, TEMPLATE_CHAIN_MAX as CHAIN, TEMPLATE_ELIF_MAX as ELIF,
    TEMPLATE_NESTING_MAX as NESTING, TEMPLATE_UNARY_MAX as UNARY, check, render,
};
use swarmbench_protocol::observation::Sight;
use swarmbench_protocol::status::Status;

/// The stack of a thread of the server is 2 MiB, and its handlers need some of it. The deepest templates take 772 KiB in
/// a debug build.
const STACK_BYTES: usize = 1024 * 1024;

fn on_a_small_stack(work: impl FnOnce() + Send + 'static) {
    let thread = std::thread::Builder::new().stack_size(STACK_BYTES).spawn(work);
    thread.expect("a thread").join().expect("no panic");
}

fn printed(expression: &str) -> String {
    format!("{{{{ {expression} }}}}")
}

/// A text between `before` and `after`, each repeated `times` times.
fn within(before: &str, times: usize, text: &str, after: &str) -> String {
    [&before.repeat(times), text, &after.repeat(times)].concat()
}

fn ifs(times: usize, text: &str) -> String {
    within("{% if 1 %}", times, text, "{% endif %}")
}

fn elifs(times: usize, text: &str) -> String {
    ifs(1, &["{% elif 1 %}".repeat(times).as_str(), text].concat())
}

type Repeated = (&'static str, usize, fn(usize) -> String);

/// Each construct that makes a syntax tree deeper, with the name and the value of the limit that counts it.
const REPEATED: [Repeated; 36] = [
    ("template_unary_max", UNARY, |n| printed(&["not ".repeat(n).as_str(), "1"].concat())),
    ("template_unary_max", UNARY, |n| printed(&["-".repeat(n).as_str(), "1"].concat())),
    ("template_unary_max", UNARY, |n| printed(&within("-(", n, "1", ")"))),
    ("template_unary_max", UNARY, |n| printed(&within("not (", n, "1", ")"))),
    ("template_unary_max", UNARY, |n| printed(&["1 is eq -", &"-".repeat(n), "1"].concat())),
    ("template_unary_max", UNARY, |n| ifs(n, &printed(&["-".repeat(n).as_str(), "1"].concat()))),
    ("template_unary_max", UNARY, |n| printed(&within("1[-", n, "1", "]"))),
    ("template_unary_max", UNARY, |n| printed(&["1 - ", &"- ".repeat(n), "1"].concat())),
    ("template_chain_max", CHAIN, |n| printed(&["a", &".i".repeat(n)].concat())),
    ("template_chain_max", CHAIN, |n| printed(&["a", &".0".repeat(n)].concat())),
    ("template_chain_max", CHAIN, |n| printed(&["a", &"[0]".repeat(n)].concat())),
    ("template_chain_max", CHAIN, |n| printed(&["a", &"|upper".repeat(n)].concat())),
    ("template_chain_max", CHAIN, |n| printed(&["a", &"|default(0)".repeat(n)].concat())),
    ("template_chain_max", CHAIN, |n| printed(&["a", &" is defined".repeat(n)].concat())),
    ("template_chain_max", CHAIN / 2, |n| printed(&["a", &" is not none".repeat(n)].concat())),
    ("template_chain_max", CHAIN / 2, |n| printed(&["a", &" not in b".repeat(n)].concat())),
    ("template_chain_max", CHAIN, |n| printed(&["a", &" in b".repeat(n)].concat())),
    ("template_chain_max", CHAIN, |n| printed(&["1", &" == 1".repeat(n)].concat())),
    ("template_unary_max", UNARY, |n| printed(&["1", &" < -1".repeat(n)].concat())),
    ("template_chain_max", CHAIN, |n| printed(&["1", &" - 1".repeat(n)].concat())),
    ("template_chain_max", CHAIN, |n| printed(&["1", &" / 1".repeat(n)].concat())),
    ("template_chain_max", CHAIN, |n| printed(&["1", &" or 1".repeat(n)].concat())),
    ("template_chain_max", CHAIN, |n| printed(&["1", &" and not 1".repeat(n)].concat())),
    ("template_chain_max", CHAIN - 2, |n| {
        printed(&["a.b == 1", &" or a.b == 1".repeat(n)].concat())
    }),
    ("template_chain_max", CHAIN, |n| printed(&["1", &" if 1".repeat(n)].concat())),
    ("template_chain_max", CHAIN, |n| printed(&["1", &" if 1 else 1".repeat(n)].concat())),
    ("template_chain_max", CHAIN, |n| ["{% if a", &".i".repeat(n), " %}{% endif %}"].concat()),
    ("template_chain_max", CHAIN - 2, |n| {
        ["{% for x in a", &".i".repeat(n), " if a", &".i".repeat(n), " %}{% endfor %}"].concat()
    }),
    ("template_chain_max", CHAIN / 2, |n| printed(&within("(", n, "a", ".i.i)"))),
    ("template_chain_max", CHAIN - 1, |n| printed(&["a is eq b", &".i".repeat(n)].concat())),
    ("template_elif_max", ELIF, |n| elifs(n, "")),
    ("template_elif_max", ELIF / 2, |n| elifs(n, &elifs(n, ""))),
    ("template_nesting_max", NESTING, |n| printed(&within("(", n, "1", ")"))),
    ("template_nesting_max", NESTING, |n| ifs(n, "")),
    ("template_nesting_max", NESTING, |n| within("{% for a in b %}", n, "", "{% endfor %}")),
    ("template_nesting_max", NESTING / 2, |n| ifs(n, &printed(&within("a[", n, "1", "]")))),
];

#[test]
fn each_limit_is_named_with_the_place_where_it_is_passed() {
    for (name, most, template) in REPEATED {
        let admitted = template(most);
        assert_eq!(check(&admitted), Ok(()), "{admitted}");
        let refused = template(most + 1);
        let problem = check(&refused).expect_err(&refused).to_string();
        assert!(problem.contains(&format!(", {name} (line 1, column ")), "{refused}: {problem}");
    }
    let problem = check(&format!("a\n{{{{ b\n  {} }}}}", ".c".repeat(CHAIN + 1)));
    let problem = problem.expect_err("a chain").to_string();
    assert_eq!(
        problem,
        "must have at most 32 links of a chain, template_chain_max (line 3, column 67)"
    );
}

/// Comments, raw text, strings and text beside tags do not nest, and siblings do not nest in each other.
#[test]
fn what_does_not_nest_is_not_counted() {
    for text in ["not ", "- ", ".i", "{% elif 0 %}", "(((", "]]", "{% if 1 %}"] {
        let text = text.repeat(900);
        for template in [
            format!("{{# {text} #}}{{{{ agent }}}}"),
            format!("{{% raw %}} {text} {{% endraw %}}"),
            format!("{{%- raw -%}} {text} {{%- endraw -%}}"),
            format!("{{{{ '{}' 'b' \"{{% if 1 %}}\" }}}}", &text[..1000]),
        ] {
            assert_eq!(check(&template), Ok(()), "{template}");
        }
    }
    for sibling in [
        "{{ -a.b.c|upper if not a.d is none else -(a)[0] }}",
        "{% if not a.b %}c{% elif d.e %}f{% else %}g{% endif %}\n",
        "{% for a in b.c if not d %}{{ loop.index }}{% else %}e{% endfor %}",
        "{{ a }} }} %} #} ) ] . - not",
    ] {
        let template = sibling.repeat(TEMPLATE_BYTES_MAX / sibling.len());
        assert_eq!(check(&template), Ok(()), "{sibling}");
    }
}

/// The deepest templates of each kind, and of kinds within each other.
fn deepest() -> Vec<String> {
    let (unary, chain) = ("not ".repeat(UNARY), ".a".repeat(CHAIN));
    let innermost = format!("{unary}agent{chain}");
    let ternary = within("1 if 1 else (", CHAIN - 1, &format!("{unary}1"), ")");
    let filter = within("1|default(", CHAIN - 1, &format!("{unary}1"), ")");
    let of_each = REPEATED.map(|(_, most, template)| template(most));
    let mut deepest = of_each.to_vec();
    deepest.extend([
        printed(&within("(", NESTING, &innermost, ")")),
        ifs(NESTING, &printed(&innermost)),
        elifs(ELIF, &ifs(NESTING - 1, &printed(&innermost))),
        ifs(NESTING - 1, &elifs(ELIF, &printed(&innermost))),
        elifs(ELIF, &printed(&ternary)),
        elifs(ELIF, &printed(&filter)),
        ifs(
            NESTING / 2,
            &elifs(ELIF, &printed(&within("(1 if 1 else ", 15, &format!("{unary}1"), ")"))),
        ),
    ]);
    deepest
}

fn sight() -> (Config, Sight) {
    let config = Config::check(&Settings::standard(TaskName::Transport, 27)).expect("settings");
    let seen = World::new(Arc::new(config.clone())).observe(AgentId(3));
    let sight = Sight::of(&seen, "ep_1".to_owned(), String::new(), Status::Running, None);
    (config, sight)
}

#[test]
fn the_deepest_templates_fit_on_a_stack() {
    let (config, sight) = sight();
    on_a_small_stack(move || {
        for template in deepest() {
            assert_eq!(check(&template), Ok(()), "{template}");
            // Failure on this observation does not matter.
            drop(render(&template, &sight, &config));
        }
    });
}

#[test]
fn what_is_too_deep_is_neither_parsed_nor_rendered() {
    let (config, sight) = sight();
    on_a_small_stack(move || {
        for (name, _, template) in REPEATED {
            let bytes = template(100).len() - template(99).len();
            let template = template((TEMPLATE_BYTES_MAX - 64) / bytes);
            for failed in [check(&template), render(&template, &sight, &config).map(drop)] {
                let problem = failed.expect_err(&template).to_string();
                assert!(problem.contains("_max (line 1, "), "{name}: {problem}");
            }
        }
    });
}

/// Templates of earlier versions may have longer texts in expressions, and nothing else that is forbidden.
#[test]
fn stored_templates_are_checked_before_they_are_rendered() {
    let (config, sight) = sight();
    let long = printed(&format!("'{}'", "a".repeat(2000)));
    assert!(check(&long).is_err());
    assert_eq!(render(&long, &sight, &config), Ok("a".repeat(2000)));
    for refused in ["{{ agent * 2 }}", "{% set a = agent %}", "{{ [agent] }}", &" ".repeat(40_000)]
    {
        let problem = check(refused).expect_err(refused);
        assert_eq!(render(refused, &sight, &config), Err(problem), "{refused}");
    }
}
