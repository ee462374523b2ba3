# Builds `surefoot` and puts it, with the trained weights inside the binary, into a small image.
# Where no registry is reachable, import local images under these names first, or set the two arguments.
ARG BUILD_IMAGE=rust:1.95-bookworm
ARG RUNTIME_IMAGE=debian:bookworm-slim

FROM ${BUILD_IMAGE} AS build
WORKDIR /src
COPY . .
RUN cargo build --release --locked --package surefoot-cli

FROM ${RUNTIME_IMAGE}
RUN useradd --system --uid 10001 --home-dir /var/lib/surefoot --create-home surefoot
COPY --from=build /src/target/release/surefoot /usr/local/bin/surefoot
USER surefoot
ENV SUREFOOT_CACHE=/var/lib/surefoot
VOLUME /var/lib/surefoot
EXPOSE 7600 7601
ENTRYPOINT ["surefoot"]
CMD ["up", "--listen", "0.0.0.0:7600", "--planner-listen", "0.0.0.0:7601", "--insecure"]
