# The version that the tests run on most; 3.12 and 3.13 work too.
ARG PYTHON_VERSION=3.11

FROM python:${PYTHON_VERSION}-slim AS builder
SHELL ["/bin/bash", "-o", "pipefail", "-c"]
WORKDIR /src
RUN python -m venv /opt/venv
# Dependencies and PostgreSQL's driver first: this layer changes only when they do.
COPY pyproject.toml constraints.txt ./
COPY client/pyproject.toml ./client/
RUN python -c "import tomllib; p, c = (tomllib.load(open(f + 'pyproject.toml', 'rb'))['project'] for f in ('', 'client/')); print(*(d for d in p['dependencies'] + c['dependencies'] if not d.startswith('armwright')), *p['optional-dependencies']['agents'], sep='\n')" > requirements.txt \
    && /opt/venv/bin/pip install --no-cache-dir --quiet -c constraints.txt -r requirements.txt
# Nothing loads these: tests, packages that build and draw, CasADi's headers, and all its solvers but IPOPT and PIQP.
RUN /opt/venv/bin/pip uninstall -y --quiet cython matplotlib contourpy cycler fonttools kiwisolver pyparsing pillow \
    && find /opt/venv/lib -name tests -type d -prune -exec rm -rf {} + \
    && find /opt/venv/lib/python*/site-packages/casadi -maxdepth 1 -name 'lib*' ! -name 'libcasadi.so.*' ! -name 'libcasadi-tp-openblas.so.0' \
    ! -name 'libcasadi_conic_piqp.so' ! -name 'libcasadi_nlpsol_ipopt.so' ! -name 'libcoinm*.so.[0-9]' ! -name 'libipopt.so.3' ! -name 'libpiqp.so' -delete \
    && rm -rf /opt/venv/lib/python*/site-packages/casadi/{include,cmake,casadi-cli,cbc,clp,highs} \
    && /opt/venv/bin/python -c "import casadi, fcl; x = casadi.SX.sym('x'); casadi.nlpsol('s', 'ipopt', {'x': x, 'f': x**2}, {'ipopt.print_level': 0, 'print_time': False})(x0=1); casadi.qpsol('q', 'piqp', {'x': x, 'f': x**2}, {'print_time': False})(x0=1)"
COPY README.md LICENSE ./
COPY scripts/one_package.py ./scripts/
COPY armwright ./armwright
COPY command_line ./command_line
COPY compiled ./compiled
COPY kinematics ./kinematics
COPY dynamics ./dynamics
COPY obstacles ./obstacles
COPY planning ./planning
COPY tracking ./tracking
COPY service ./service
COPY client ./client
RUN /opt/venv/bin/pip install --no-cache-dir --quiet --no-deps -c constraints.txt . ./client
# Machine code beside the code: any user finds it, and nothing is written. For x86-64-v3 (AVX2), and
# for AVX-512 too where the image is built on a processor that has it.
RUN ARMWRIGHT_KERNEL_TARGET=x86-64-v3 /opt/venv/bin/armwright warm --in-package \
    && /opt/venv/bin/armwright warm --in-package


# No apt packages: the wheels bring all but libc, libstdc++ and zlib, which the slim image has.
FROM python:${PYTHON_VERSION}-slim
ENV PATH=/opt/venv/bin:$PATH \
    PYTHONUNBUFFERED=1 \
    PYTHONDONTWRITEBYTECODE=1 \
    PYTHONSAFEPATH=1 \
    NUMBA_CACHE_DIR=/var/cache/armwright \
    MPLCONFIGDIR=/var/cache/armwright/matplotlib \
    ARMWRIGHT_HOST=0.0.0.0 \
    ARMWRIGHT_PORT=8000 \
    ARMWRIGHT_DATA_DIR=/data
RUN useradd --system --create-home --uid 10001 armwright \
    && install -d -o armwright -g armwright /data /var/cache/armwright
COPY --from=builder /opt/venv /opt/venv
USER 10001
WORKDIR /data
# Only a processor without AVX2 compiles, once, into NUMBA_CACHE_DIR; /readyz waits for that.
VOLUME /data
EXPOSE 8000
STOPSIGNAL SIGTERM
HEALTHCHECK --interval=15s --timeout=5s --start-period=120s --retries=3 \
    CMD ["python", "-c", "import os, urllib.request; urllib.request.urlopen('http://127.0.0.1:' + os.environ['ARMWRIGHT_PORT'] + '/healthz', timeout=4)"]
CMD ["armwright", "serve"]
