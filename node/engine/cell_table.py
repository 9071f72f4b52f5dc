"""The table by which a generation's compiled code finds a cell's arrays (`node.engine.rule`), place by place."""

from node.engine.layout import RowLayout, TableLayout

# Places of the table. A shape of three dimensions is seen as two: all but the last are merged into rows.
TABLE = TableLayout()

# The rows of `wire.exchange.Messages`: the cell's own messages, then its neighbours'.
HEADER = TABLE.integers("header")
GENOMES = TABLE.octets("genomes")
FITNESS = TABLE.reals("fitness")

# The inbox, see `node.engine.inbox.Inbox`.
SOURCE_ROWS = TABLE.integers("source_rows")
LATEST = TABLE.integers("latest")
COUNTS = TABLE.integers("counts")
USED = TABLE.integers("used")
STALENESS = TABLE.integers("staleness")
INBOX = TABLE.integers("inbox")  # the inbox's own table

# The deme, see `node.engine.rows.Rows`.
DEME = TABLE.octets("deme")
DEME_FITNESS = TABLE.reals("deme_fitness")
BETTER_AT = TABLE.integers("better_at")
CLOCK = TABLE.integers("clock")  # (1,): the generation
NOTED_FITNESS = TABLE.reals("noted_fitness")
TARGET = TABLE.reals("target")  # (1,)

# Room for breeding: the couples' indices in the deme, their genomes, and their offspring.
PARENTS = TABLE.integers("parents")  # (couples, 2)
COUPLES = TABLE.octets("couples")  # (2 * couples, genome_bytes)
OFFSPRING = TABLE.octets("offspring")  # (2 * couples, genome_bytes)
OFFSPRING_FITNESS = TABLE.reals("offspring_fitness")  # (2 * couples,)
VARIATION_TABLE = TABLE.integers("variation_table")  # the tables of the operators whose addresses are in the settings
MUTATE_TABLE = TABLE.integers("mutate_table")
FITNESS_TABLE = TABLE.integers("fitness_table")

# What is kept of each generation: the history, the outbox, and the improvements.
RECORD = TABLE.octets("record")  # room for what is digested of a generation
DIGEST = TABLE.integers("digest")  # the columns of `node.engine.sha256.STATE`
OUT = TABLE.octets("out")  # the outbox, see `node.engine.ring`
OUT_ENTRIES = TABLE.integers("out_entries")
OUT_MARKS = TABLE.integers("out_marks")
OUT_WITH_STATE = TABLE.octets("out_with_state")  # the latest message that carries the cell's state
BIRTHS = TABLE.integers("births")  # (MOST_BIRTHS, 2): generation and cell of each improvement noted
BIRTH_FITNESS = TABLE.reals("birth_fitness")  # (MOST_BIRTHS,)
BIRTH_COUNT = TABLE.integers("birth_count")  # (1,)

SETTINGS_ROW = TABLE.integers("settings_row")  # the columns of `SETTINGS`
OUTCOME_ROW = TABLE.integers("outcome_row")  # the columns of `OUTCOME`

# What does not change during an epoch.
SETTINGS = RowLayout()
VARIATION = SETTINGS.column("variation")  # addresses of operators
MUTATE_ONE_BIT = SETTINGS.column("mutate_one_bit")  # 0: none
FITNESS_KERNEL = SETTINGS.column("fitness_kernel")
EMIGRANTS = SETTINGS.column("emigrants")  # taken from each neighbour
ELITIST = SETTINGS.column("elitist")
SEED = SETTINGS.column("seed")  # 64 bits, to be read as unsigned
CELL = SETTINGS.column("cell")
FIRST_EVALUATIONS = SETTINGS.column("first_evaluations")  # of the first deme
EVALUATIONS = SETTINGS.column("evaluations")  # of each generation
INTERVAL = SETTINGS.column("interval")
LOCKSTEP = SETTINGS.column("lockstep")
CHAMPION = SETTINGS.column("champion")  # whether messages carry it
TARGET_REPORTER = SETTINGS.column("target_reporter")  # negative: each cell reports its own
STALL = SETTINGS.column("stall")  # negative: no limit
STOP_DISTANCE = SETTINGS.column("stop_distance")
TOLD_STOP = SETTINGS.column("told_stop")  # a stop that others know, but may tell too late; else the limit
LIMIT = SETTINGS.column("limit")
FAMILIES = SETTINGS.column("families")
BETTER_HALF = SETTINGS.column("better_half")
MOST_SELECTIONS = SETTINGS.column("most_selections")
MOST_BYTES = SETTINGS.column("most_bytes")  # of a message without a state
STATE_BYTES = SETTINGS.column("state_bytes")  # of the longest state; 0: messages carry none

# What does change: messages between two that carry the cell's state, a power of two.
STATE_EVERY = SETTINGS.column("state_every")
STATE_NEXT = SETTINGS.column("state_next")  # whether the next message carries the state in any case

# What a call of `breed_on` has done.
OUTCOME = RowLayout()
BRED = OUTCOME.column("bred")  # generations
FLAGS = OUTCOME.column("flags")  # see `node.engine.flags`
SIZE = OUTCOME.column("size")  # of the message to send, in bytes; 0: there is none
HAS_STATE = OUTCOME.column("has_state")  # whether that message is the one with the cell's state
WRONG = OUTCOME.column("wrong")  # after UNSOUND, the index of the offspring whose fitness is unsound
