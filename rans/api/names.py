"""Loading by names that a user gives, of which MODULE:NAME may run code (`rans.registry.typed`)."""

from rans.model import spacecraft_file
from rans.randomization import conditions_file
from rans.registry import by_user
from rans.tasks import load_task as _load_task

load_spacecraft = by_user(spacecraft_file.load_spacecraft)
load_conditions = by_user(conditions_file.load_conditions)
load_task = by_user(_load_task)
