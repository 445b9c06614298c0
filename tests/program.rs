//! The program as its users run it: commands, evaluations, language models, tables, and data of others.

mod cli;
mod dataset;
mod eval;
mod llm;
mod tables;
