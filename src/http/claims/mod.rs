//! Claims: the seats of one episode are divided between several holders.

pub(super) mod create;
pub(super) mod list;
