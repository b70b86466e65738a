# The station in a container: docker build -t gse . && docker run --rm -v "$PWD:/work" gse run
# With a serial port: docker run --rm -v "$PWD:/work" --device /dev/ttyUSB0 gse run --station roof.yaml
FROM python:3.11-slim-bookworm AS build
WORKDIR /source
COPY pyproject.toml README.md LICENSE ./
COPY gse gse
COPY drivers drivers
COPY protocols protocols
RUN python -m venv /opt/gse && /opt/gse/bin/pip install --no-cache-dir .

FROM python:3.11-slim-bookworm
COPY --from=build /opt/gse /opt/gse
# A user of its own: serial ports belong to the group dialout.
RUN useradd --uid 1000 --create-home --groups dialout gse
USER 1000
WORKDIR /work
ENTRYPOINT ["/opt/gse/bin/gse"]
CMD ["--help"]
