# Not built yet by its makers, who have no Docker at hand.
# The station in a container: docker build -t gse . && docker run --rm -v "$PWD:/work" gse run
# With a serial port: docker run --rm -v "$PWD:/work" --device /dev/ttyUSB0 gse run --station roof.yaml
# As another user (--user), or read-only: -v gse-cache:/cache -e XDG_CACHE_HOME=/cache, a volume that this user can write.
FROM python:3.11-slim-bookworm AS build
WORKDIR /source
COPY pyproject.toml constraints.txt README.md LICENSE ./
COPY gse gse
COPY drivers drivers
COPY protocols protocols
RUN python -m venv /opt/gse && /opt/gse/bin/pip install --no-cache-dir -c constraints.txt .

FROM python:3.11-slim-bookworm
COPY --from=build /opt/gse /opt/gse
# A user of its own: serial ports belong to the group dialout.
RUN useradd --uid 1000 --create-home --groups dialout gse
# Machine code for every processor of this kind, compiled now, where the user can write: else each start takes a minute.
ENV NUMBA_CPU_NAME=generic XDG_CACHE_HOME=/var/cache/gse
RUN install -d -o gse -m 700 /var/cache/gse
USER 1000
RUN /opt/gse/bin/gse run --no-plots --out /tmp/first && rm -r /tmp/first
WORKDIR /work
ENTRYPOINT ["/opt/gse/bin/gse"]
CMD ["--help"]
