# Builds `surefoot`, which includes Studio's page and the trained weights, and `surefoot-lab`, and copies both into a small image.
# If no registry is reachable, first import local images under these names, or set the three arguments.
ARG NODE_IMAGE=node:22-bookworm-slim
ARG BUILD_IMAGE=rust:1.95-bookworm
ARG RUNTIME_IMAGE=debian:bookworm-slim

FROM ${NODE_IMAGE} AS page
WORKDIR /src/studio/page
COPY studio/page/package.json studio/page/package-lock.json studio/page/.npmrc ./
RUN npm ci
COPY proto /src/proto
COPY studio/page ./
RUN npm run build

FROM ${BUILD_IMAGE} AS build
WORKDIR /src
COPY . .
COPY --from=page /src/studio/page/dist studio/page/dist
RUN SUREFOOT_STUDIO=/src/studio/page/dist cargo build --release --locked --features agones,fleet

FROM ${RUNTIME_IMAGE}
RUN useradd --system --uid 10001 --home-dir /var/lib/surefoot --create-home surefoot
COPY --from=build /src/target/release/surefoot /src/target/release/surefoot-lab /usr/local/bin/
# The authorities that clients of S3 and of services with TLS trust.
COPY --from=build /etc/ssl/certs/ca-certificates.crt /etc/ssl/certs/ca-certificates.crt
COPY cli/THIRD_PARTY_NOTICES.md LICENSE* /usr/share/doc/surefoot/
USER 10001
ENV SUREFOOT_CACHE=/var/lib/surefoot
VOLUME /var/lib/surefoot
EXPOSE 7600 7601
ENTRYPOINT ["surefoot"]
CMD ["up", "--listen", "0.0.0.0:7600", "--planner-listen", "0.0.0.0:7601", "--insecure"]
