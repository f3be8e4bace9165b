from .rendering import Code as Code
from .safe_limits import SafeLimits as SafeLimits
from .safe_limits import Stated as Stated
from .safe_limits import safe_limits as safe_limits
from .streaming_law import StreamingLaw as StreamingLaw
from .streaming_law import streaming_law as streaming_law
