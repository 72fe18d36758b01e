"""Sources of the physics of the effects."""

TOOLBOX = "Malzahn, Roozing, Tsagarakis, The Compliant Joint Toolbox for MATLAB"
EMPS = "Janot, Gautier, Brunot (2019), Data Set and Reference Models of EMPS"
ARMSTRONG = "Armstrong-Helouvry, Dupont, Canudas de Wit (1994), Automatica 30(7)"
LUGRE = "Canudas de Wit, Olsson, Astrom, Lischinsky (1995), IEEE Trans. Automatic Control 40(3)"
PASSIVE_LUGRE = "Barahanov, Ortega (2000), IEEE Trans. Automatic Control 45(4)"
SERVO_FRICTION = (
    "Duclusaud, Passault, Padois, Ly (2024), Extended Friction Models, arXiv 2410.08650"
)
NORDIN = "Nordin, Gutman (2002), Automatica 38(10)"
BOUC_WEN = "Ismail, Ikhouane, Rodellar (2009), Arch. Computational Methods in Engineering 16(2)"
MAXWELL_SLIP = "Al-Bender, Lampaert, Swevers (2005), IEEE Trans. Automatic Control 50(11)"
HUNT_CROSSLEY = "Hunt, Crossley (1975), Journal of Applied Mechanics 42(2)"
TREMOR = "Elble, Koller (1990), Tremor"
MACHINES = "Hendershot, Miller (2010), Design of Brushless Permanent-Magnet Machines"
CURRENT_ERRORS = "Chung, Sul (1998), IEEE Trans. Industry Applications 34(2)"
RANDOM_WALK = "IEEE Std 952-1997, angle and rate random walk"
CATALOGUE = "Tolerances of catalogue parts"
