//! Claims: seats of one episode that belong to several holders.

pub(super) mod create;
pub(super) mod list;
