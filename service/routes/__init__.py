"""The endpoints: each parses, calls and responds."""

from fastapi import APIRouter, Depends

from service.dependencies import require_key
from service.routes import edits, events, meshes, operations, results
from service.routes.documents import problems

v1 = APIRouter(prefix="/v1", dependencies=[Depends(require_key)], responses=problems(401, 403, 503))
v1.include_router(meshes.router)
v1.include_router(edits.router)
v1.include_router(events.router)
v1.include_router(results.router)

router = APIRouter()
router.include_router(v1)
router.include_router(operations.router)

__all__ = ["router"]
