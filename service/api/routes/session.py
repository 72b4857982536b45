"""A browser's session: sign in with a key, ask who is signed in, sign out."""

from __future__ import annotations

from fastapi import APIRouter, Depends, Response

from service.api.auth import SESSION_COOKIE, AnyActor, require_own_page
from service.api.deps import BaseUrl, KernelDep
from service.api.schemas.session import SessionIn, SessionOut
from service.domain.access import Actor
from service.usecases.keys import authenticate

router = APIRouter(prefix="/v1/session", tags=["session"])

_MAX_AGE_S = 30 * 24 * 3600


@router.put("", response_model=SessionOut, dependencies=[Depends(require_own_page)])
def sign_in(kernel: KernelDep, base_url: BaseUrl, response: Response, body: SessionIn) -> SessionOut:
    """Sign a browser in: the key goes into a cookie that no script can read.

    The cookie is HttpOnly and SameSite=Strict, and Secure where the service is reached by HTTPS. Needs the
    header `X-Groundplan-Session: 1`, as every change does that comes with the cookie. The key stays what it
    was: when it is revoked or expires, the session ends.
    """
    with kernel.db.reading() as session:
        actor = authenticate(session, body.key.strip(), now=kernel.now())
    response.set_cookie(
        SESSION_COOKIE,
        body.key.strip(),
        max_age=_MAX_AGE_S,
        httponly=True,
        samesite="strict",
        secure=base_url.startswith("https:"),
    )
    response.headers["Cache-Control"] = "no-store"
    return _shown(actor)


@router.get("", response_model=SessionOut)
def get_session(actor: AnyActor, response: Response) -> SessionOut:
    """Tell whose key this is: its id, its role and its maps. Any valid key may ask."""
    response.headers["Cache-Control"] = "no-store"
    return _shown(actor)


@router.delete("", status_code=204, dependencies=[Depends(require_own_page)])
def sign_out(response: Response) -> None:
    """Take the key out of the browser again. The key itself stays valid. Needs no key."""
    response.delete_cookie(SESSION_COOKIE, httponly=True, samesite="strict")


def _shown(actor: Actor) -> SessionOut:
    maps = None if actor.map_ids is None else sorted(actor.map_ids)
    return SessionOut(key_id=actor.key_id, role=actor.role, map_ids=maps)
