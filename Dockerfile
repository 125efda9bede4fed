# RANS with everything, without CUDA: docker build -t rans . && docker run --rm -v "$PWD:/work" rans train go-to-pose
FROM python:3.12-slim-bookworm

# Drake's wheel asks for the libraries of X, and a compiler checks exports as C.
RUN apt-get update \
    && apt-get install -y --no-install-recommends gcc libc6-dev libglib2.0-0 libsm6 libx11-6 \
    && rm -rf /var/lib/apt/lists/*

COPY . /rans
RUN pip install --no-cache-dir -c /rans/constraints.txt torch --index-url https://download.pytorch.org/whl/cpu \
    && pip install --no-cache-dir -c /rans/constraints.txt /rans/agents '/rans[all]'

WORKDIR /work
ENTRYPOINT ["rans"]
CMD ["--help"]
