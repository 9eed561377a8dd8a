"""The code of every kind of error that a user can see.

Values only. The first digit is the part of srprov that an error is about. A code never changes its meaning, and one
that is not used any more is not given to another kind: `tests/golden/codes.txt` holds the list. What each means, with
examples, is in `explaining/*.yml`, which `srprov explain` and docs/errors.md show.
"""

from __future__ import annotations

import enum


class Code(str, enum.Enum):
    """`SRP-NNN`: 0 srprov and its lab, 1 definitions, 2 inventory and configuration, 3 SSH, 4 assignment and so on."""

    # srprov itself, and the lab
    BUG = "SRP-001"
    LAB_MACHINE = "SRP-010"
    LAB_DOWN = "SRP-011"
    LAB_STUCK = "SRP-012"
    LAB_ORDER = "SRP-013"

    # definitions: EDFs, CDFs, playbooks, and the files of other tools
    UNREADABLE = "SRP-101"
    YAML = "SRP-102"
    TWICE = "SRP-103"
    WRONG_KIND = "SRP-104"
    UNKNOWN_KEY = "SRP-105"
    MISSING_KEY = "SRP-106"
    WRONG_TYPE = "SRP-107"
    WRONG_VALUE = "SRP-108"
    EXCLUSIVE = "SRP-109"
    TOO_LARGE = "SRP-110"
    NAME = "SRP-111"
    NO_SUCH_FILE = "SRP-112"
    OUTSIDE = "SRP-113"
    NO_SUCH_NAME = "SRP-114"
    DEPENDENCY = "SRP-115"
    RELATION = "SRP-116"
    VOLUME = "SRP-117"
    SECRET = "SRP-118"  # noqa: S105 - a code
    ENVIRONMENT = "SRP-119"
    UNRESOLVED = "SRP-120"
    OVERLAY = "SRP-121"
    ORIGIN = "SRP-130"
    DOCKERFILE = "SRP-131"
    IMAGE_NAME = "SRP-132"
    REPOSITORY = "SRP-133"
    TEMPLATE = "SRP-140"
    PLAYBOOK = "SRP-141"
    RENDERED = "SRP-142"
    TRIAL_DESIGN = "SRP-150"
    TRIAL_JUDGING = "SRP-151"
    LOCK_FILE = "SRP-160"
    COMPOSE = "SRP-170"
    COMPOSE_VARIABLE = "SRP-171"
    SWARMROB = "SRP-172"
    NOT_TRANSLATED = "SRP-173"

    # inventory, command line and configuration
    INVENTORY = "SRP-201"
    HOST_VARIABLE = "SRP-202"
    INVENTORY_PROGRAM = "SRP-203"
    UNNAMED_INVENTORY = "SRP-204"
    NO_MATCH = "SRP-205"
    NO_ROBOT = "SRP-206"
    UNKNOWN_VERB = "SRP-210"
    UNKNOWN_OPTION = "SRP-211"
    OPTION_VALUE = "SRP-212"
    OPTIONS = "SRP-213"
    WHICH = "SRP-214"
    NO_FILE = "SRP-220"
    CANNOT_WRITE = "SRP-221"
    IN_THE_WAY = "SRP-222"
    CONFIGURATION = "SRP-230"
    NOT_INSTALLED = "SRP-231"
    FACTS_FILE = "SRP-232"

    # reaching robots
    LOOKUP = "SRP-301"
    CONNECT = "SRP-302"
    HANDSHAKE = "SRP-303"
    HOST_KEY = "SRP-304"
    HOST_KEY_CHANGED = "SRP-305"
    LOGIN = "SRP-306"
    SUDO = "SRP-307"
    SHELL = "SRP-308"
    DEADLINE = "SRP-309"
    LOST = "SRP-310"
    SSH_CONFIG = "SRP-311"
    ANSWER = "SRP-312"
    ENGINE = "SRP-313"
    NEEDED_ROBOT = "SRP-314"
    SITE = "SRP-315"

    # who runs what
    NO_PLACEMENT = "SRP-401"
    TOO_HARD = "SRP-402"
    CONTRADICTION = "SRP-403"

    # permissions, trust, plans
    NOT_ALLOWED = "SRP-501"
    LAB_POLICY = "SRP-502"
    NOT_CONFIRMED = "SRP-503"
    NO_TERMINAL = "SRP-504"
    NO_PLAN = "SRP-510"
    PLAN_CHANGED = "SRP-511"
    STALE_PLAN = "SRP-512"
    STRANGE_PLAN = "SRP-513"
    PLAN_MISFIT = "SRP-514"
    SIGNATURE = "SRP-515"
    OWNER = "SRP-520"
    DISPUTED = "SRP-521"
    STRANGE_FILE = "SRP-522"
    SECRET_SHOWN = "SRP-523"  # noqa: S105 - a code
    PLAIN_CLUSTER = "SRP-524"

    # changing robots, and looking into what runs
    LOCKED = "SRP-601"
    NOTHING_RUNS = "SRP-602"
    NO_ROOM = "SRP-603"
    RESULTS = "SRP-604"
    AWAITED = "SRP-605"
    COMMAND = "SRP-606"
    STEP_FAILED = "SRP-607"

    # the overlay
    VNI = "SRP-701"
    SUBNET = "SRP-702"
    UNDERLAY = "SRP-703"
    ENCRYPTION = "SRP-704"
    NETWORK_ABILITY = "SRP-705"
    PROBE = "SRP-706"

    # images and data sets
    NO_IMAGE = "SRP-801"
    PLATFORM = "SRP-802"
    DIGESTS = "SRP-803"
    IMAGE_COPY = "SRP-804"
    DATA_SET = "SRP-805"

    # records, trials and bundles
    NO_RUN = "SRP-901"
    RECORD = "SRP-902"
    EXPERIMENT_CHANGED = "SRP-903"
    NO_BUNDLE = "SRP-904"
    BUNDLE_FALSE = "SRP-905"
    NOT_COMPARABLE = "SRP-906"
    REPLAY = "SRP-907"

    def __str__(self) -> str:
        """Return `SRP-NNN`."""
        return str(self.value)
