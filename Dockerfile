# Build:  docker build -t swarmbench .
# Run:    docker run -p 8080:8080 -v swarmbench:/data swarmbench
#
# The default command serves without keys (--open): anyone who reaches the port may create episodes. For a server that
# others can reach, give a command of your own, for example: docker run … swarmbench serve --help

# The slim image brings gcc and the C library's headers. No package more is needed: ring and the bundled SQLite are
# compiled by gcc alone, from sources and bindings that their crates ship (no cmake, no libclang, no pkg-config).
FROM rust:1.95-slim-bookworm AS build
WORKDIR /src

# Line tables are for profiles on a developer's machine; function names in backtraces stay.
ENV CARGO_PROFILE_RELEASE_STRIP=debuginfo

COPY . .

# Dependencies and objects are kept between builds in caches outside the layers, so a change of one file compiles that
# crate alone. The target folder is a cache, so the binary is copied out of it in the same step.
RUN --mount=type=cache,id=swarmbench-registry,target=/usr/local/cargo/registry,sharing=locked \
    --mount=type=cache,id=swarmbench-target,target=/src/target,sharing=locked \
    cargo build --release --locked --package swarmbench --bin swarmbench \
 && cp target/release/swarmbench /usr/local/bin/swarmbench

FROM debian:bookworm-slim

# Certificate authorities, for players that call a language model over HTTPS.
COPY --from=build /etc/ssl/certs/ca-certificates.crt /etc/ssl/certs/ca-certificates.crt
COPY --from=build /usr/local/bin/swarmbench /usr/local/bin/swarmbench

# A named volume takes over the owner of this folder; a bind mount has to be writable for user 10001 already.
RUN install --directory --owner=10001 --group=10001 --mode=0750 /data
VOLUME /data
USER 10001:10001
WORKDIR /data

EXPOSE 8080
HEALTHCHECK --interval=10s --timeout=5s --start-period=20s --retries=3 \
    CMD ["swarmbench", "healthcheck", "--server", "http://127.0.0.1:8080"]

ENTRYPOINT ["swarmbench"]
CMD ["serve", "--addr", "0.0.0.0:8080", "--db", "/data/swarmbench.db", "--open"]
