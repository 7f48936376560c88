"""Certificates that are made when a test runs, with openssl; none is ever kept."""

from __future__ import annotations

import subprocess
from pathlib import Path

from bridge.endpoints import Tls


def openssl(folder: Path, *arguments: str) -> None:
    subprocess.run(["openssl", *arguments], cwd=folder, check=True, capture_output=True, timeout=60)


def authority(folder: Path, name: str) -> None:
    key = ("-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:prime256v1", "-nodes")
    made = ("-keyout", f"{name}.key", "-out", f"{name}.pem", "-subj", f"/CN={name}", "-days", "2")
    openssl(folder, "req", "-x509", *key, *made, "-addext", "keyUsage=critical,keyCertSign,cRLSign")


def certificate(folder: Path, name: str, signed_by: str = "authority") -> Tls:
    extensions = folder / f"{name}.ext"
    extensions.write_text(
        "subjectAltName=IP:127.0.0.1,DNS:localhost\nextendedKeyUsage=serverAuth,clientAuth\nbasicConstraints=CA:FALSE\n"
    )
    openssl(folder, "ecparam", "-name", "prime256v1", "-genkey", "-noout", "-out", f"{name}.sec1")
    openssl(folder, "pkcs8", "-topk8", "-nocrypt", "-in", f"{name}.sec1", "-out", f"{name}.key")
    openssl(folder, "req", "-new", "-key", f"{name}.key", "-subj", f"/CN={name}", "-out", f"{name}.csr")
    by = ("-CA", f"{signed_by}.pem", "-CAkey", f"{signed_by}.key", "-CAcreateserial")
    openssl(folder, "x509", "-req", "-in", f"{name}.csr", *by, "-days", "2", "-extfile", extensions.name, "-out", f"{name}.pem")
    return Tls(str(folder / "authority.pem"), str(folder / f"{name}.pem"), str(folder / f"{name}.key"))
