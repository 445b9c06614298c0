//! The nesting depth of a template, counted by its tokens.
//!
//! The template engine parses, compiles and frees an expression by recursion, and its own limit of depth ignores prefix
//! operators, chains and `elif`. So the tokens are counted first, by the engine's tokenizer. Each count covers
//! everything that encloses one place: no syntax tree is deeper than the sum of the four limits.

use minijinja::machinery::{Span, Token, tokenize};

use super::{REFUSED_STATEMENTS, TemplateError, refuse, syntax};

/// Prefix operators (`not`, `-`) around a place.
pub const TEMPLATE_UNARY_MAX: usize = 16;

/// Links of a chain: `.a`, `[b]`, `(c)`, `|d`, `is e`, operators between operands, and `if` in expressions. Both sides
/// of `and`, `or`, `if` and `else` have their own links, of which the longer chain counts.
pub const TEMPLATE_CHAIN_MAX: usize = 32;

/// Number of `elif`s of the `if`s around a place.
pub const TEMPLATE_ELIF_MAX: usize = 64;

/// Blocks and brackets around a place.
pub const TEMPLATE_NESTING_MAX: usize = 32;

/// Checks that the engine can parse a template: fails at the first token that goes beyond a limit.
pub(super) fn check(template: &str) -> Result<(), TemplateError> {
    let mut reader = Reader::default();
    for token in tokenize(template, false, syntax()) {
        let (token, span) = token?;
        reader.span = span;
        reader.take(&token)?;
    }
    reader.end_tag()
}

/// Depths of an expression.
#[derive(Clone, Copy, Default)]
struct Depth {
    unary: usize,
    chain: usize,
}

impl Depth {
    fn or_deeper(self, other: Self) -> Self {
        Self { unary: self.unary.max(other.unary), chain: self.chain.max(other.chain) }
    }
}

/// An expression within a tag or a bracket, as far as it was read.
#[derive(Default)]
struct Level {
    /// Number of `and`, `or` and `if`: they bind least, so any of them may enclose any operand.
    joins: usize,
    /// The deepest of their operands read so far.
    deepest: Depth,
    operand: Depth,
}

impl Level {
    fn depth(&self) -> Depth {
        let Depth { unary, chain } = self.deepest.or_deeper(self.operand);
        Depth { unary, chain: self.joins + chain }
    }

    fn end_operand(&mut self) {
        self.deepest = self.deepest.or_deeper(std::mem::take(&mut self.operand));
    }
}

/// The kind of the last token.
#[derive(Clone, Copy, Default, PartialEq, Eq)]
enum Last {
    /// An operator: an operand has to follow.
    #[default]
    Operator,
    Operand,
    /// The start of a filter or a test: its name and its arguments follow.
    Filter,
    /// The start of a block tag: a keyword follows.
    BlockStart,
}

#[derive(Default)]
struct Reader {
    /// The blocks around this place, each with its `elif`s.
    blocks: Vec<usize>,
    /// The brackets around this place, each with the expression outside of it as far as it was read.
    brackets: Vec<Level>,
    level: Level,
    last: Last,
    /// The position of the last token.
    span: Span,
}

impl Reader {
    fn take(&mut self, token: &Token<'_>) -> Result<(), TemplateError> {
        use Token as T;
        let was = std::mem::take(&mut self.last);
        match token {
            T::TemplateData(_) | T::VariableStart => {}
            T::BlockStart => self.last = Last::BlockStart,
            T::VariableEnd | T::BlockEnd => return self.end_tag(),
            T::Ident(keyword) if was == Last::BlockStart => return self.keyword(keyword),
            T::Ident("and" | "or" | "if") => self.join(1),
            T::Ident("else") | T::Comma | T::Colon | T::Assign => self.join(0),
            T::Ident("not") | T::Minus if was == Last::Operator => self.level.operand.unary += 1,
            T::Ident("is") | T::Pipe => {
                self.level.operand.chain += 1;
                self.last = Last::Filter;
            }
            T::ParenOpen | T::BracketOpen | T::BraceOpen => {
                self.level.operand.chain += usize::from(was == Last::Operand);
                self.brackets.push(std::mem::take(&mut self.level));
            }
            T::ParenClose | T::BracketClose | T::BraceClose => self.close(),
            T::Ident("not" | "in") => self.level.operand.chain += 1,
            T::Ident(_) if was == Last::Filter => self.last = was,
            T::Ident(_) | T::Str(_) | T::String(_) | T::Int(_) | T::Int128(_) | T::Float(_) => {
                self.last = Last::Operand;
            }
            _ => self.level.operand.chain += 1,
        }
        self.check()
    }

    /// Counts the blocks that `for` and `if` open; all keywords that do not belong to these are refused.
    fn keyword(&mut self, keyword: &str) -> Result<(), TemplateError> {
        match keyword {
            "for" | "if" => self.blocks.push(0),
            "endfor" | "endif" => drop(self.blocks.pop()),
            "elif" => self.blocks.iter_mut().next_back().into_iter().for_each(|elifs| *elifs += 1),
            "else" => {}
            _ => return refuse(REFUSED_STATEMENTS),
        }
        self.check()
    }

    fn join(&mut self, joins: usize) {
        self.level.end_operand();
        self.level.joins += joins;
    }

    /// Closes a bracket: its content is part of the operand outside.
    fn close(&mut self) {
        if let Some(outside) = self.brackets.pop() {
            let Depth { unary, chain } = std::mem::replace(&mut self.level, outside).depth();
            self.level.operand.unary += unary;
            self.level.operand.chain += chain;
        }
        self.last = Last::Operand;
    }

    fn end_tag(&mut self) -> Result<(), TemplateError> {
        while !self.brackets.is_empty() {
            self.close();
        }
        let checked = self.check();
        (self.level, self.last) = Default::default();
        checked
    }

    fn check(&self) -> Result<(), TemplateError> {
        let Depth { unary, chain } = self.level.depth();
        let nesting = self.blocks.len() + self.brackets.len();
        self.within(unary, TEMPLATE_UNARY_MAX, "template_unary_max", "prefix operators")?;
        self.within(chain, TEMPLATE_CHAIN_MAX, "template_chain_max", "links of a chain")?;
        let elifs = self.blocks.iter().sum();
        self.within(elifs, TEMPLATE_ELIF_MAX, "template_elif_max", "elif of an if")?;
        self.within(
            nesting,
            TEMPLATE_NESTING_MAX,
            "template_nesting_max",
            "nested blocks and brackets",
        )
    }

    fn within(&self, is: usize, most: usize, name: &str, of: &str) -> Result<(), TemplateError> {
        if is <= most {
            return Ok(());
        }
        let (line, column) = (self.span.start_line, u32::from(self.span.start_col) + 1);
        let problem =
            format!("must have at most {most} {of}, {name} (line {line}, column {column})");
        Err(TemplateError(problem))
    }
}
