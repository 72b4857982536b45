"""The refusals of the product: one tree, one leaf a fact.

DomainError
├── Denied        who asks is unknown, or may not do this
├── NotFound      the thing named does not exist, or not for this caller
├── Conflict      right in itself, but not in the present state
├── Rejected      the input is wrong, and will be wrong the next time too
├── Unfulfilled   the work was done and its result is not good enough; never answers a request
└── Unavailable   not now; the same call may succeed later

A leaf stands in the module of its subject, and is imported from here. Its docstring is its public page, its
class name in kebab-case its slug, and `title` its fixed title. Which HTTP status a class has is decided in
`service.api.problems` alone.
"""

from service.domain.errors.access import *  # noqa: F403 - the leaves, and nothing else, are re-exported
from service.domain.errors.files import *  # noqa: F403
from service.domain.errors.fleet import *  # noqa: F403
from service.domain.errors.jobs import *  # noqa: F403
from service.domain.errors.maps import *  # noqa: F403
from service.domain.errors.requests import *  # noqa: F403
from service.domain.errors.tree import *  # noqa: F403
from service.domain.errors.uploads import *  # noqa: F403
