//! A fake language model: an OpenAI-compatible endpoint that runs offline and plays badly, but by the rules. For trying
//! `swarmbench eval` without a provider, a key or costs.
//!
//! `cargo run --example fake_model -- 9090`, and then
//! `swarmbench eval --task all --seeds 27 --model fake --api-base http://127.0.0.1:9090/v1`

mod endpoint;

use std::net::Ipv4Addr;
use std::process::ExitCode;

use tokio::net::TcpListener;

#[tokio::main]
async fn main() -> ExitCode {
    let port = match std::env::args().nth(1).map_or(Ok(9090), |port| port.parse::<u16>()) {
        Ok(port) => port,
        Err(error) => return failed(&format!("the argument is the port to listen at: {error}")),
    };
    let listener = match TcpListener::bind((Ipv4Addr::LOCALHOST, port)).await {
        Ok(listener) => listener,
        Err(error) => return failed(&format!("port {port}: {error}")),
    };
    let address = listener.local_addr().expect("a listener has an address");
    println!("the model `fake` answers at http://{address}/v1");
    match axum::serve(listener, endpoint::router()).await {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => failed(&error.to_string()),
    }
}

fn failed(why: &str) -> ExitCode {
    eprintln!("{why}");
    ExitCode::FAILURE
}
