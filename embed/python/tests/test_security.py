"""A server with TLS and tokens."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import trustme
from conftest import Process

import surefoot

SECRET = "the-secret-of-a-client"


@dataclass
class Guarded:
    """A server, and the certificates of its authority and of another one."""

    process: Process
    authority: Path
    stranger: Path


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Guarded]:
    folder = tmp_path_factory.mktemp("guarded")
    authority, stranger = folder / "authority.pem", folder / "stranger.pem"
    issuer = trustme.CA()
    issuer.cert_pem.write_to_path(authority)
    trustme.CA().cert_pem.write_to_path(stranger)
    own = issuer.issue_cert("127.0.0.1")
    own.private_key_pem.write_to_path(folder / "server.key")
    for part in own.cert_chain_pems:
        part.write_to_path(folder / "server.pem", append=True)
    (folder / "tokens.toml").write_text(f'[[token]]\nname = "tests"\nrole = "client"\nsecret = "{SECRET}"\n')
    files = {"--tls-cert": "server.pem", "--tls-key": "server.key", "--tokens": "tokens.toml"}
    arguments = [text for flag, file in files.items() for text in (flag, str(folder / file))]
    process = Process(folder, *arguments, authority=authority)
    yield Guarded(process, authority, stranger)
    process.stop()


def test_environments_run_behind_tls_with_a_token(guarded: Guarded, islands: surefoot.Level) -> None:
    server = surefoot.connect(guarded.process.uri, token=SECRET, tls_ca=guarded.authority)
    there, here = (surefoot.VectorEnv(4, islands, server=it) for it in (server, None))
    np.testing.assert_array_equal(there.reset(seed=1)[0], here.reset(seed=1)[0])
    action = np.ones((4, 4), np.float32)
    np.testing.assert_array_equal(there.step(action)[0], here.step(action)[0])


def test_a_certificate_of_another_authority_is_refused(guarded: Guarded) -> None:
    for authority in (guarded.stranger, None):
        with pytest.raises(ConnectionError, match="certificate: UnknownIssuer .tls_ca is its authority"):
            surefoot.connect(guarded.process.uri, token=SECRET, tls_ca=authority)


def test_a_name_that_is_not_in_the_certificate_is_refused(guarded: Guarded) -> None:
    with pytest.raises(ConnectionError, match="certificate not valid for name.*tls_server_name the name"):
        surefoot.connect(guarded.process.uri, tls_ca=guarded.authority, tls_server_name="elsewhere")


@pytest.mark.parametrize("token", ["the-secret-of-another", None])
def test_a_wrong_token_is_refused(guarded: Guarded, token: str | None, islands: surefoot.Level) -> None:
    server = surefoot.connect(guarded.process.uri, token=token, tls_ca=guarded.authority)
    with pytest.raises(ValueError, match="refused: .*token is (unknown|required).*Unauthenticated"):
        surefoot.VectorEnv(1, islands, server=server)


def test_a_certificate_file_that_does_not_exist_is_named(guarded: Guarded, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"missing\.pem: No such file or directory \(os error 2\)$"):
        surefoot.connect(guarded.process.uri, tls_ca=tmp_path / "missing.pem")
