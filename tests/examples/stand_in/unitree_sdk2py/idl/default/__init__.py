from unitree_sdk2py.idl.unitree_hg.msg.dds_ import LowCmd_, LowState_


def unitree_hg_msg_dds__LowCmd_():
    return LowCmd_()


def unitree_hg_msg_dds__LowState_():
    return LowState_()
