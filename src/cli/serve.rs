//! `swarmbench serve`

use std::net::{Ipv4Addr, Ipv6Addr, SocketAddr};
use std::path::PathBuf;

use anyhow::{Context, bail};
use ipnet::IpNet;
use swarmbench_clock::files::read_text;
use tokio::net::TcpListener;

use crate::http::limits::Limits;
use crate::http::{Access, Source};
use crate::ids::RoutingName;
use crate::server::{Parts, Server, fit_memory, fit_open_files, listen};
use crate::store::{Joining, Location};
use crate::telemetry::{LogFormat, start_logs};

#[derive(Debug, clap::Args)]
pub(super) struct Args {
    /// The address and port to listen on.
    #[arg(long, env = "SWARMBENCH_ADDR", default_value = "127.0.0.1:8080")]
    addr: SocketAddr,
    /// The database: a file of SQLite, created if it does not exist, which one server at a time can use; or
    /// `postgres://USER@HOST/DATABASE`, with the password in PGPASSWORD, in ~/.pgpass, or in a file: `?password_file=FILE`.
    #[arg(long, env = "SWARMBENCH_DB", hide_env_values = true, default_value = "swarmbench.db")]
    db: Location,
    /// Open server: while no keys exist, everyone who can reach the server may create, watch and abort episodes, not only
    /// programs on this machine.
    #[arg(long, env = "SWARMBENCH_OPEN", value_parser = clap::builder::FalseyValueParser::new())]
    open: bool,
    /// Private server: every read needs a key or a token of the episode, even of episodes that have ended.
    #[arg(long, env = "SWARMBENCH_PRIVATE", value_parser = clap::builder::FalseyValueParser::new())]
    private: bool,
    /// The address or network (10.0.0.0/8) of a trusted proxy: the server believes its X-Forwarded-For header.
    #[arg(long, env = "SWARMBENCH_TRUSTED_PROXY", value_delimiter = ',', value_name = "NETWORK", value_parser = network)]
    trusted_proxy: Vec<IpNet>,
    /// A name by which clients reach this server, such as swarm.example.org: /mcp answers requests for these names, for
    /// addresses and for localhost only.
    #[arg(long, env = "SWARMBENCH_HOST", value_delimiter = ',', value_name = "NAME", value_parser = host)]
    host: Vec<String>,
    /// Rate limit: requests per second from one address, on average; 0 for no limit. Programs on this machine are not limited.
    #[arg(long, env = "SWARMBENCH_ADDRESS_REQUESTS_PER_S", default_value_t = Limits::default().address_requests_per_s_max)]
    address_requests_per_s: u32,
    /// Rate limit: requests per second with one key and the tokens of its episodes; 0 for no limit.
    #[arg(long, env = "SWARMBENCH_KEY_REQUESTS_PER_S", default_value_t = Limits::default().key_requests_per_s_max)]
    key_requests_per_s: u32,
    /// Rate limit: entries in competitions per hour from one address without an invitation; 0 for no limit. Programs on this
    /// machine are not limited.
    #[arg(long, env = "SWARMBENCH_ENTRIES_PER_ADDRESS_H", default_value_t = Limits::default().entries_per_address_h_max)]
    entries_per_address_h: u32,
    /// The maximum number of unfinished episodes on the server at a time.
    #[arg(long, env = "SWARMBENCH_EPISODES_MAX", default_value_t = Limits::default().episodes_unfinished_max)]
    episodes_max: usize,
    /// The maximum number of unfinished episodes of one key at a time.
    #[arg(long, env = "SWARMBENCH_EPISODES_PER_KEY", default_value_t = Limits::default().episodes_per_key_max)]
    episodes_per_key: usize,
    /// The maximum number of bytes of acts in all episodes of one key; all acts of a competition may take four times as many.
    #[arg(long, env = "SWARMBENCH_JOURNAL_BYTES_PER_KEY", default_value_t = Limits::default().journal_bytes_per_key_max)]
    journal_bytes_per_key: u64,
    /// The free space of the disk, in percent, below which nothing new is created; a disk with 2 GiB free is never full. 0
    /// for no limit.
    #[arg(long, env = "SWARMBENCH_DISK_FREE_PERCENT_MIN", default_value_t = Limits::default().disk_free_percent_min)]
    disk_free_percent_min: u32,
    /// The memory limit of all worlds and large answers together, such as 6GiB. With 512MiB or more the process takes at most
    /// twice as much. Default: half of the memory of the machine or the control group.
    #[arg(long, env = "SWARMBENCH_MEMORY_MAX", value_name = "BYTES", value_parser = bytes)]
    memory_max: Option<usize>,
    /// Serve the files of pages from this folder instead of those in the program: for developers of the pages.
    #[arg(long, env = "SWARMBENCH_PAGES", value_name = "FOLDER")]
    pages: Option<PathBuf>,
    /// Join other servers on the same PostgreSQL database: the host and port where they reach this server. The address must
    /// not be reachable from outside.
    #[arg(long, env = "SWARMBENCH_CLUSTER_ADDRESS", value_name = "HOST:PORT", group = "joins", requires = "cluster_secret_file", value_parser = reachable)]
    cluster_address: Option<String>,
    #[arg(long, env = "SWARMBENCH_NODE", hide = true, group = "joins", requires = "cluster_secret_file", value_parser = reachable)]
    node: Option<String>,
    /// The address and port on which to listen for the other servers, if they differ from --cluster-address. Default where that
    /// has a name: all addresses, at the same port.
    #[arg(long, env = "SWARMBENCH_CLUSTER_LISTEN", value_name = "ADDR:PORT", requires = "joins")]
    cluster_listen: Option<SocketAddr>,
    #[arg(long, env = "SWARMBENCH_NODE_LISTEN", hide = true, requires = "joins")]
    node_listen: Option<SocketAddr>,
    /// Play no games: answer from the database, and forward all other requests to the other servers.
    #[arg(long, env = "SWARMBENCH_FORWARD_ONLY", requires = "joins", value_parser = clap::builder::FalseyValueParser::new())]
    forward_only: bool,
    /// The name of this server for load balancers, two characters of a–z and 2–7, such as s2: seat and swarm tokens begin
    /// with it, so that a load balancer can send a request to the server that plays. Each server has its own, and keeps it.
    #[arg(long, env = "SWARMBENCH_ROUTING_NAME", value_name = "NAME", requires = "joins", value_parser = routing_name)]
    routing_name: Option<RoutingName>,
    /// A file with the shared secret of the cluster, at least 16 bytes: `openssl rand -hex 32` makes one.
    #[arg(long, env = "SWARMBENCH_CLUSTER_SECRET_FILE", value_name = "FILE", requires = "joins")]
    cluster_secret_file: Option<PathBuf>,
    /// The log format; `RUST_LOG` sets the log level.
    #[arg(long, env = "SWARMBENCH_LOG_FORMAT", default_value = "text")]
    log_format: LogFormat,
}

impl Args {
    /// Address at which the other servers of a cluster reach this one. The options and variables with `node` are older names.
    fn cluster_address(&self) -> Option<&str> {
        self.cluster_address.as_deref().or(self.node.as_deref())
    }
}

fn network(text: &str) -> Result<IpNet, String> {
    let address = || text.parse::<std::net::IpAddr>().map(IpNet::from);
    text.parse()
        .or_else(|_| address())
        .map_err(|_| "an address such as 127.0.0.1 or a network such as 10.0.0.0/8".to_owned())
}

fn reachable(text: &str) -> Result<String, String> {
    let is_of_name = |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '-');
    let is_host = |host: &str| {
        let is_name = !host.is_empty() && host.chars().all(is_of_name);
        let inner = host.strip_prefix('[').and_then(|host| host.strip_suffix(']'));
        is_name || inner.is_some_and(|host| host.parse::<Ipv6Addr>().is_ok())
    };
    let is_port = |port: &str| port.parse::<u16>().is_ok_and(|port| port > 0);
    if text.rsplit_once(':').is_some_and(|(host, port)| is_host(host) && is_port(port)) {
        Ok(text.to_owned())
    } else {
        Err("an address and a port such as 10.0.0.5:7000 or one.example.org:7000, without http://"
            .to_owned())
    }
}

fn routing_name(text: &str) -> Result<RoutingName, String> {
    RoutingName::parse(text).ok_or_else(|| "two characters of a–z and 2–7, such as s2".to_owned())
}

/// Minimum bytes of a cluster's secret.
const SECRET_BYTES_MIN: usize = 16;

/// Listens for the other servers of a cluster, if this server joins one.
fn joining(args: &Args) -> anyhow::Result<Option<(TcpListener, Joining)>> {
    let Some((address, file)) = args.cluster_address().zip(args.cluster_secret_file.as_ref())
    else {
        return Ok(None);
    };
    let secret = read_text(file).with_context(|| {
        format!("the secret of the cluster in {} cannot be read", file.display())
    })?;
    let secret = secret.trim_ascii().as_bytes();
    if secret.len() < SECRET_BYTES_MIN {
        bail!(
            "the secret in {} has {} bytes, {SECRET_BYTES_MIN} are needed: `openssl rand -hex 32` makes a good one",
            file.display(),
            secret.len()
        );
    }
    let usual = || -> Option<SocketAddr> {
        let port = address.rsplit_once(':')?.1.parse().ok()?;
        Some(address.parse().unwrap_or_else(|_| (Ipv4Addr::UNSPECIFIED, port).into()))
    };
    let at = args.cluster_listen.or(args.node_listen).or_else(usual);
    let at = at.context("--cluster-address has no port")?;
    // Listens before it joins: success proves that an earlier process at this address has ended.
    let listener = listen(at).with_context(|| {
        format!("cannot listen on {at} for the other servers; is another program there?")
    })?;
    let joining = Joining {
        address: address.to_owned(),
        secret: secret.into(),
        forwards_only: args.forward_only,
        routing_name: args.routing_name,
        host_ms: crate::membership::host_ms,
    };
    Ok(Some((listener, joining)))
}

fn host(text: &str) -> Result<String, String> {
    let is_name = |c: char| c.is_ascii_alphanumeric() || matches!(c, '.' | '-' | '_');
    if text.is_empty() || !text.chars().all(is_name) {
        return Err(
            "a name such as swarm.example.org, without http:// and without a port".to_owned()
        );
    }
    Ok(text.to_ascii_lowercase())
}

/// Parses a number of bytes: 6GiB, 512MiB, 1000000.
fn bytes(text: &str) -> Result<usize, String> {
    let units = [("KiB", 1 << 10), ("MiB", 1 << 20), ("GiB", 1 << 30), ("TiB", 1 << 40)];
    let unit = units.iter().find_map(|(name, size)| Some((text.strip_suffix(name)?, *size)));
    let (number, size) = unit.unwrap_or((text, 1_usize));
    let number = number.trim().parse::<usize>().ok().and_then(|number| number.checked_mul(size));
    number
        .filter(|bytes| *bytes >= MEMORY_LEAST)
        .ok_or_else(|| "a number of bytes, at least 16MiB, such as 6GiB or 512MiB".to_owned())
}

/// Minimum memory, below which no game fits.
const MEMORY_LEAST: usize = 16 << 20;

fn access(args: &Args) -> Access {
    Access {
        open: args.open,
        private: args.private,
        trusted_proxies: args.trusted_proxy.clone(),
        hosts: args.host.clone(),
    }
}

pub(super) async fn run(args: Args) -> anyhow::Result<()> {
    start_logs(args.log_format);
    let stop = swarmbench_commands::stop::asked_to_stop();
    let limits = Limits {
        address_requests_per_s_max: args.address_requests_per_s,
        key_requests_per_s_max: args.key_requests_per_s,
        entries_per_address_h_max: args.entries_per_address_h,
        episodes_unfinished_max: args.episodes_max,
        episodes_per_key_max: args.episodes_per_key,
        journal_bytes_per_key_max: args.journal_bytes_per_key,
        disk_free_percent_min: args.disk_free_percent_min,
        ..Limits::default()
    };
    let limits = fit_memory(limits, args.memory_max);
    let (for_servers, joining) = joining(&args)?.unzip();
    let access = access(&args);
    let pages = args.pages.map_or_else(Source::default, Source::Folder);
    let parts =
        Parts { limits: fit_open_files(limits), access, pages, joining, ..Parts::default() };
    let server = Server::open(&args.db, parts).await?;
    if !args.addr.ip().is_loopback() && !args.open && !server.has_keys() {
        server.close().await;
        bail!(
            "{} can be reached from other machines, and a server without keys is open to all of them. \
             Create a key first: swarmbench key create --name YOU --role organizer --db {}; or listen on 127.0.0.1; \
             or add --open if everyone who can reach it may use it",
            args.addr,
            args.db
        );
    }
    if args.open && server.has_keys() {
        tracing::warn!("--open has no effect: there are keys, so creating an episode needs one");
    }
    let listener = listen(args.addr)
        .with_context(|| format!("cannot listen on {}; is another server there?", args.addr))?;
    let addr = listener.local_addr()?;
    tracing::info!(%addr, db = %args.db, "serving; documentation at http://{addr}/docs");
    server.run_with(listener, for_servers, stop).await?;
    tracing::info!("stopped");
    Ok(())
}

#[cfg(test)]
mod tests {
    use clap::Parser as _;

    use super::*;

    #[derive(Debug, clap::Parser)]
    struct Command {
        #[command(flatten)]
        args: Args,
    }

    #[test]
    fn options_of_a_cluster_have_older_names() {
        for (address, listen) in
            [("--cluster-address", "--cluster-listen"), ("--node", "--node-listen")]
        {
            let secret = ["serve", "--cluster-secret-file", "secret"];
            let place = [address, "10.0.0.5:7000", listen, "0.0.0.0:7001"];
            let words = secret.into_iter().chain(place);
            let Command { args } = Command::try_parse_from(words).expect("good options");
            assert_eq!(args.cluster_address(), Some("10.0.0.5:7000"));
            assert_eq!(args.cluster_listen.or(args.node_listen).map(|at| at.port()), Some(7001));
            for part in [&secret[..], &["serve", address, "10.0.0.5:7000"]] {
                assert!(Command::try_parse_from(part).is_err(), "{part:?} is not all");
            }
        }
    }

    #[test]
    fn bytes_have_units() {
        assert_eq!(bytes("6GiB"), Ok(6 << 30));
        assert_eq!(bytes("512 MiB"), Ok(512 << 20));
        assert_eq!(bytes("20000000"), Ok(20_000_000));
        for bad in ["", "GiB", "6GB", "-1", "1.5GiB", "99999999999999TiB", "1MiB"] {
            assert!(bytes(bad).is_err(), "{bad}");
        }
    }
}
