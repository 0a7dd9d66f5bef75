"""The server: links, device sessions, streaming, recordings and the HTTP API. The only package that uses asyncio and
FastAPI.
"""

import os

# numpy's BLAS otherwise splits even a dot product of 10,000 numbers between all cores; its threads wait for each other
# in busy loops and take three times the processor time, of the streams too. Read when numpy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
