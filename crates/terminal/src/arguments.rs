//! Parsing of command lines: negative numbers are values, and errors name what is expected.

use std::error::Error as _;
use std::net::AddrParseError;
use std::num::{IntErrorKind, ParseFloatError, ParseIntError};

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{CommandFactory, FromArgMatches};

/// The command of a program with all subcommands.
#[must_use]
pub fn command<Cli: CommandFactory>() -> clap::Command {
    with_negative_numbers(Cli::command())
}

/// Parses the arguments of this process. Exits on errors, and for `--help` and `--version`.
#[must_use]
pub fn parse<Cli: CommandFactory + FromArgMatches>() -> Cli {
    let matches = command::<Cli>().try_get_matches_from(std::env::args_os());
    let cli = matches.and_then(|mut matches| Cli::from_arg_matches_mut(&mut matches));
    cli.unwrap_or_else(|error| in_words(error).exit())
}

/// Makes `-1` a value instead of an option, so that a number out of range gets the error that names the range.
fn with_negative_numbers(command: clap::Command) -> clap::Command {
    let command = command.mut_args(|argument| {
        let takes_values = argument.get_action().takes_values();
        if takes_values { argument.allow_negative_numbers(true) } else { argument }
    });
    command.mut_subcommands(with_negative_numbers)
}

/// Adds what was expected to errors of numbers and addresses, whose parsers do not say it.
#[must_use]
pub fn in_words(error: clap::Error) -> clap::Error {
    let text = |kind| match error.get(kind) {
        Some(ContextValue::String(text)) => text.as_str(),
        _ => "",
    };
    let (argument, value) = (text(ContextKind::InvalidArg), text(ContextKind::InvalidValue));
    let Some(source) = error.source() else { return error };
    let expected = if let Some(number) = source.downcast_ref::<ParseIntError>() {
        match number.kind() {
            IntErrorKind::PosOverflow | IntErrorKind::NegOverflow => "it is out of range",
            _ if value.parse::<i128>().is_ok() => "must be a whole number, 0 or more",
            _ => "must be a whole number",
        }
    } else if source.is::<ParseFloatError>() {
        "must be a number"
    } else if source.is::<AddrParseError>() {
        "must be an address and a port, such as 127.0.0.1:8080 or 0.0.0.0:8080"
    } else {
        return error;
    };
    let message = format!(
        "invalid value '{value}' for '{argument}': {expected}\n\nFor more information, try '--help'.\n"
    );
    clap::Error::raw(ErrorKind::ValueValidation, message)
}
