from .closed_loop import simulate as simulate
from .evaluation import evaluate as evaluate
from .evaluation import stack_plants as stack_plants
from .evaluation import stack_references as stack_references
from .metrics import score as score
from .traversal import traversal_score as traversal_score
