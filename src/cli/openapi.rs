//! `swarmbench openapi`

#[derive(Debug, clap::Args)]
pub(super) struct Args {}

#[expect(clippy::unnecessary_wraps, reason = "all commands have the same shape")]
pub(super) fn run(_: &Args) -> anyhow::Result<()> {
    super::output::data(&crate::http::openapi::document());
    Ok(())
}
